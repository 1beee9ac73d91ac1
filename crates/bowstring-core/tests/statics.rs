//! Static equilibria against independent references.

mod common;
use bowstring_core::model::load::{Load, Model, TendonPath, Theory};
use bowstring_core::statics::solver::{Solver, Status};
use common::{by_tensions, study_robot};

/// Tension, x and z of the tip in mm: Kirchhoff, then Cosserat. Independent shooting solutions.
#[rustfmt::skip]
const SWEEP: [[f64; 5]; 17] = [
    [0.0, 0.0, 641.0, 0.0, 641.0],
    [5.0, 27.77888727, 640.19672805, 27.778686, 640.19207],
    [10.0, 55.56058998, 637.77806013, 55.559787, 637.768778],
    [15.0, 83.23698196, 633.73650122, 83.235182, 633.722664],
    [20.0, 110.69858358, 628.07244855, 110.695401, 628.054156],
    [25.0, 137.83517404, 620.79437947, 137.830235, 620.771763],
    [30.0, 164.53642754, 611.91898962, 164.529372, 611.892213],
    [35.0, 190.69256893, 601.4712786, 190.683053, 601.440532],
    [40.0, 216.19504466, 589.48458062, 216.182744, 589.450082],
    [45.0, 240.93720393, 576.00053785, 240.921814, 575.96253],
    [50.0, 264.81498521, 561.06901489, 264.796226, 561.027763],
    [55.0, 287.72760257, 544.74795294, 287.705216, 544.703743],
    [60.0, 309.57822647, 527.10316305, 309.551981, 527.0563],
    [65.0, 330.2746531, 508.20805811, 330.244344, 508.15886],
    [70.0, 349.72995672, 488.14332398, 349.695406, 488.092125],
    [75.0, 367.86311886, 466.99653059, 367.824177, 466.943675],
    [80.0, 384.59962882, 444.86168461, 384.556175, 444.807525],
];

fn model(theory: Theory) -> Model {
    Model {
        theory,
        ..Model::default()
    }
}

/// Tip position in mm.
fn tip(elements: usize, n: usize, clamp: f64, theory: Theory, load: &Load) -> [f64; 3] {
    let mut solver = Solver::new(&study_robot(n, clamp), model(theory), elements).unwrap();
    let outcome = solver.solve(load).unwrap();
    assert_eq!(outcome.status, Status::Converged, "{outcome:?}");
    assert_eq!(outcome.stable, Some(true));
    solver.tip().unwrap().position.0.map(|x| x * 1e3)
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn study_sweep_error_below_1e_5_of_length() {
    for row in SWEEP {
        let tensions = [row[0], 0.0, 0.0];
        let k = distance(
            tip(1, 9, 0.0, Theory::Kirchhoff, &by_tensions(&tensions)),
            [row[1], 0.0, row[2]],
        );
        let c = distance(
            tip(1, 9, 0.0, Theory::Cosserat, &by_tensions(&tensions)),
            [row[3], 0.0, row[4]],
        );
        let fine = distance(
            tip(4, 9, 0.0, Theory::Kirchhoff, &by_tensions(&tensions)),
            [row[1], 0.0, row[2]],
        );
        println!("{} N: {k:.6} {c:.6} {fine:.7} mm", row[0]);
        assert!(k < 0.006 && c < 0.006 && fine < 1e-4);
    }
}

#[test]
fn four_load_cases() {
    let (up, none) = ([0.0, 0.0, -9.81], [0.0; 3]);
    let cases = [
        (
            40.0,
            none,
            [0.0, 1.0, 0.0],
            [213.2847328, 80.8790081, 583.962985],
            [213.27286, 80.87176, 583.92931],
        ),
        (
            80.0,
            none,
            [-1.0, 0.0, 0.0],
            [348.7254904, 0.0, 483.7078543],
            [348.68959, 0.0, 483.64498],
        ),
        (
            40.0,
            up,
            none,
            [239.0139242, 0.0, 578.1474897],
            [238.99937, 0.0, 578.11313],
        ),
        (0.0, up, none, [0.0, 0.0, 641.0], [0.0, 0.0, 641.0]),
    ];
    for (f, gravity, tip_force, kirchhoff, cosserat) in cases {
        let load = Load {
            tensions: &[f, 0.0, 0.0],
            gravity,
            tip_force,
            tip_moment: none,
            ..Load::default()
        };
        let k = distance(tip(1, 9, 0.0, Theory::Kirchhoff, &load), kirchhoff);
        let fine = distance(tip(4, 9, 0.0, Theory::Kirchhoff, &load), kirchhoff);
        let c = distance(tip(1, 9, 0.0, Theory::Cosserat, &load), cosserat);
        println!("{k:.6} {fine:.7} {c:.6}");
        assert!(k < 0.006 && fine < 1e-4);
        // no Cosserat value is given for the last case: the rod shortens slightly
        assert!(c < 0.006);
    }
}

#[test]
fn continuous_tendon_is_the_limit_of_many_disks() {
    let closed = [377.307635, 0.0, 454.867397];
    let load = by_tensions(&[80.0, 0.0, 0.0]);
    let mut solver = Solver::new(
        &study_robot(9, 0.0),
        Model {
            theory: Theory::Kirchhoff,
            tendon: TendonPath::Continuous,
            twist: true,
        },
        1,
    )
    .unwrap();
    solver.solve(&load).unwrap();
    let own = distance(solver.tip().unwrap().position.0.map(|x| x * 1e3), closed);
    println!("continuous: {own:.7} mm");
    assert!(own < 1e-5);
    let errors =
        [9, 18, 36, 72, 144].map(|n| distance(tip(1, n, 0.0, Theory::Kirchhoff, &load), closed));
    println!("{errors:?}");
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 2.0).abs() < 0.1, "order {order}");
    }
}
