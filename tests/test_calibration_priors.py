"""Priors of a fit: their weight, intervals and defaults; all tables are synthetic."""

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Prior, default_priors
from bowstring.calibration.cross_validation import cross_validate
from bowstring.calibration.fitting import fit, fit_from
from bowstring.calibration.intervals import Dependence, Uncertainty
from bowstring.calibration.observations import Data
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.priors import Priors, deviations_of, with_priors
from objects import refused
from test_calibration_fitting import (
    GIVE,
    ONE_DISPLACED,
    PER_UNIT,
    E,
    giving,
    masses,
    single,
    slack_bench,
    synthetic,
)


def random_loads(rows, seed):
    return np.random.default_rng(seed).uniform(0, 40, (rows, 3))


def dependence(rows, *, apart=True):
    """Rows that are no neighbours of each other, or all neighbours with correlation 0.8."""
    run = np.arange(rows) if apart else np.zeros(rows, dtype=int)
    own = np.arange(rows)
    return Dependence(0.0 if apart else 0.8, not apart, run, row=own, point=0 * own)


# -- weight ----------------------------------------------------------------------------------


def test_a_parameter_that_data_do_not_identify_keeps_its_prior_synthetic():
    """Without gravity tips determine only the ratio of E to the gain of all tensions."""
    data = synthetic(single(), [E], {E: 36e9})
    alone = fit(single(), data, [E, "gain"])
    assert alone.not_identifiable == ((E, "gain"),)
    found = fit(single(), data, [E, Prior("gain", 0.02)])
    assert found.converged and not found.not_identifiable
    gain, stiffness = found["gain"], found[E]
    assert gain.value == pytest.approx(1.0, abs=1e-3)
    assert gain.standard_error == pytest.approx(0.02, rel=1e-3)
    assert stiffness.value == pytest.approx(36, rel=1e-3)
    assert stiffness.standard_error == pytest.approx(0.02 * 36, rel=0.01)
    assert found.correlation[0, 1] > 0.999
    # an interval of a known standard deviation is normal, however few the rows
    assert gain.high - gain.value == pytest.approx(1.96 * 0.02, rel=2e-3)
    assert "Determined by their priors, not by these data: gain." in found.message
    assert (gain.prior_mean, gain.prior_sd) == (1.0, 0.02) and stiffness.prior_sd is None


def test_a_parameter_without_effect_may_have_a_prior_synthetic():
    data = synthetic(single(), [E], {})
    mass = "segments.0.disks.mass"  # without gravity
    found = fit(single(), data, [E, Prior(mass, 3e-4)])[mass]
    assert found.value == pytest.approx(20.0) and found.standard_error == pytest.approx(0.3)


@pytest.mark.parametrize("loss", ["linear", "soft_l1", "huber"])
def test_estimates_lie_between_data_and_prior_by_their_weights_synthetic(loss):
    """The posterior mean of one parameter of a nearly linear model, with known noise."""
    data = synthetic(single(), ["gain"], {"gain": 1.02}, noise=1e-2)
    alone = fit(single(), data, ["gain"], loss=loss)["gain"]
    found = fit(single(), data, [Prior("gain", 0.01)], loss=loss)["gain"]
    precision = np.array([alone.standard_error**-2, 0.01**-2])
    mean = precision @ [alone.value, 1.0] / precision.sum()
    assert 1.0 < found.value < alone.value
    assert found.value == pytest.approx(mean, abs=0.1 * alone.standard_error)
    assert found.standard_error == pytest.approx(precision.sum() ** -0.5, rel=0.05)


def test_a_wide_prior_changes_nothing_and_a_narrow_one_holds_synthetic():
    data = synthetic(single(), ["gain"], {"gain": 1.05})
    alone, wide, narrow = (
        fit(single(), data, [gain, "base.x"])
        for gain in ("gain", Prior("gain", 10.0), Prior("gain", 1e-7))
    )
    for a, b in zip(alone.estimates, wide.estimates, strict=True):
        assert b.value == pytest.approx(a.value, abs=0.02 * a.standard_error)
        assert b.standard_error == pytest.approx(a.standard_error, rel=0.01)
    assert alone.noise == pytest.approx(wide.noise, rel=1e-3)
    assert narrow["gain"].value == pytest.approx(1.0, abs=1e-3)
    assert "The data contradict the priors of gain: without priors" in narrow.message
    assert "contradict" not in wide.message


def test_the_initial_value_does_not_move_the_prior_synthetic():
    data = synthetic(single(), ["gain"], {"gain": 1.03}, noise=5e-3)
    ends = [
        fit(single(), data, [Prior("gain", 0.01)], start=start)["gain"]
        for start in (None, {"gain": 1.2})
    ]
    assert [end.prior_mean for end in ends] == [1.0, 1.0] and ends[1].start == 1.2
    assert ends[0].value == pytest.approx(ends[1].value, abs=2e-4)
    # frames have no nominal value but the one that is given
    found = fit(single(), data, [Prior("tool.z", 1e-3)], start={"tool.z": 8e-3})
    assert found["tool.z"].prior_mean == pytest.approx(8.0)


def test_more_parameters_than_rows_need_priors_synthetic():
    names = [E, "gain.tendons", "pitch_radius", "hole_angle"]
    truth = {E: 33e9, "gain.tendons.1": 1.02}
    data = synthetic(single(), names, truth, tensions=random_loads(4, 0), noise=1e-4)
    refused("4 measured points are too few for 6 parameters", lambda: fit(single(), data, names))
    found = fit(single(), data, [E, *map(Prior, names[1:])])
    assert found.converged and not found.not_identifiable
    assert found[E].low < 33 < found[E].high
    assert found["gain.tendons.1"].low < 1.02 < found["gain.tendons.1"].high


def test_correlated_errors_have_less_weight_against_priors():
    """A random walk in the residuals: hardly more than one independent row in each of its spans."""
    rng = np.random.default_rng(0)
    rows, size = 400, 30
    jacobian = np.repeat(rng.normal(size=(rows // 10, 3, 2)), 10, axis=0).reshape(-1, 2)
    residuals = np.repeat(rng.normal(size=(rows // 10, 3)), 10, axis=0).ravel()
    by = residuals, np.ones_like(residuals)
    prior = np.array([[size, 0.0]])
    free, tied = (
        Uncertainty.of(by, jacobian, prior, 1.0, dependence(rows, apart=apart))
        for apart in (True, False)
    )
    assert free.noise == pytest.approx(1.0, rel=0.1)
    assert 2.0 < tied.noise < np.sqrt(10)
    assert 1.0 < free.determined < 2.0


@pytest.mark.parametrize("from_commands", [True, False])
def test_intervals_hold_the_truth_with_any_errors_of_a_row(from_commands):
    """Errors of commands move a tip along its derivatives by a stiffness, and far tips more.

    By one variance for each coordinate the interval of the stiffness would hold it in half of
    the draws.
    """
    rng, none = np.random.default_rng(5), np.empty((0, 2))
    held, trials, rows = np.zeros(2), 400, 24
    for _ in range(trials):
        size = rng.uniform(0, 1, rows)
        by_stiffness = size[:, None] * rng.normal(size=(rows, 3))
        jacobian = np.stack([by_stiffness, rng.normal(size=(rows, 3))], axis=2).reshape(-1, 2)
        error = 0.1 * rng.normal(size=(rows, 3))
        if from_commands:
            error += by_stiffness * rng.normal(size=(rows, 1))
        estimate, *_ = np.linalg.lstsq(jacobian, error.ravel(), rcond=None)
        left = error.ravel() - jacobian @ estimate
        found = Uncertainty.of((left, np.ones_like(left)), jacobian, none, 0.0, dependence(rows))
        held += np.abs(estimate) < found.half * np.sqrt(np.diag(found.covariance))
    assert ((held > 0.92 * trials) & (held < 0.99 * trials)).all()


@pytest.mark.parametrize("parameters", [2, 5])
def test_the_covariance_is_that_of_fits_without_each_row(parameters):
    """Also with more parameters than coordinates of a row."""
    rng, rows = np.random.default_rng(6), 30
    jacobian, values = rng.normal(size=(rows, 3, parameters)), rng.normal(size=(rows, 3))

    def estimate(kept):
        given = jacobian[kept].reshape(-1, parameters)
        return np.linalg.lstsq(given, values[kept].ravel(), rcond=None)[0]

    whole = estimate(slice(None))
    left = (values - jacobian @ whole).ravel()
    changes = np.array([estimate(np.arange(rows) != row) - whole for row in range(rows)])
    none = np.empty((0, parameters))
    by = left, np.ones_like(left)
    found = Uncertainty.of(by, jacobian.reshape(-1, parameters), none, 0.0, dependence(rows))
    np.testing.assert_allclose(found.covariance, changes.T @ changes, rtol=1e-9, atol=1e-12)


def test_a_row_that_determines_a_direction_alone_has_the_noise_of_the_others():
    rng, none = np.random.default_rng(5), np.empty((0, 2))
    jacobian = rng.normal(size=(30, 3, 2))
    jacobian[1:, :, 1] = 0.0
    jacobian[0, :, 1] = [2.0, 0.0, 0.0]
    left = rng.normal(size=90)
    left[0] = 0.0
    by = left, np.ones_like(left)
    found = Uncertainty.of(by, jacobian.reshape(-1, 2), none, 0.0, dependence(30))
    assert np.sqrt(found.covariance[1, 1]) == pytest.approx(0.5, rel=0.3)


def test_the_posterior_of_a_linear_model():
    """Covariance by Bayes' rule for known noise; without priors that of least squares."""
    rng = np.random.default_rng(3)
    jacobian, noise = rng.normal(size=(3 * 4000, 3)), 0.7
    residuals = noise * rng.normal(size=len(jacobian))
    prior = np.diag([noise / 0.01, 0.0, noise / 0.002])[[0, 2]]
    by = residuals, np.ones_like(residuals)
    found = Uncertainty.of(by, jacobian, prior, noise, dependence(4000))
    precision = jacobian.T @ jacobian / noise**2 + np.diag([0.01**-2, 0.0, 0.002**-2])
    assert found.covariance == pytest.approx(np.linalg.inv(precision), rel=0.03, abs=2e-6)
    assert found.noise == pytest.approx(noise, rel=0.02)


@pytest.mark.slow
def test_the_cost_of_the_piecewise_model_includes_the_priors_synthetic():
    """Two minima of nearly the same error: a prior decides, and the interval ends there."""
    data = slack_bench(ONE_DISPLACED, 5e-4, 1)
    alone = fit(giving(1e-4), data, [GIVE, "offset.tendons"])["offset.tendons.0"]
    found = fit(giving(1e-4), data, [GIVE, Prior("offset.tendons", 1e-4)])
    offset = found["offset.tendons.0"]
    assert found.converged and alone.high - alone.low > 1.0
    assert offset.high - offset.low < 0.6 and offset.low < offset.value < offset.high


def test_outliers_hardly_move_a_robust_fit_with_priors_synthetic():
    data = synthetic(single(), ["gain"], {"gain": 1.01})
    data.points[7:10] += 0.03
    robust, plain = (
        fit(single(), data, [Prior("gain"), "base"], loss=loss)["gain"].value
        for loss in ("soft_l1", "linear")
    )
    assert abs(robust - 1.01) < 0.1 * abs(plain - 1.01)


def test_friction_and_priors_synthetic():
    names = ["segments.0.tendons.friction", E, "gain"]
    truth = {names[0]: 0.1, E: 36e9}
    robot = single().with_({names[0]: 0.05})
    data = synthetic(robot, names, truth, tensions=masses())
    found = fit(robot, data, [Prior(names[0], 1.0), E, Prior("gain", 0.02)])
    assert found.converged
    assert found[names[0]].value == pytest.approx(0.1, rel=0.01)
    assert found["gain"].standard_error == pytest.approx(0.02, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["linear", "soft_l1"])
def test_intervals_cover_truths_drawn_from_the_priors_synthetic(loss):
    """Six rows: E and base are free, gains are half known, holes are left to their priors."""
    names = [E, "gain.tendons", "pitch_radius", "hole_angle", "base.rz"]
    priors, held = default_priors(single(), names), []
    for seed in range(50):
        rng = np.random.default_rng(seed)
        truth = {E: 35e9 * (1 + rng.normal(0, 0.05)), "base.rz": rng.normal(0, 0.02)}
        neutral = {name: 0.0 if name == "hole_angle" else 1.0 for name in priors}
        truth |= {name: neutral[name] + rng.normal(0, sd) for name, sd in priors.items()}
        loads = random_loads(6, 1000 + seed)  # draws of their own, as the noise
        data = synthetic(single(), names, truth, tensions=loads, noise=5e-4, seed=2000 + seed)
        found = fit(single(), data, [E, *map(Prior, names[1:-1]), "base.rz"], loss=loss)
        assert found.converged
        for e in found.estimates:
            held.append(e.low <= truth[e.name] / PER_UNIT[e.unit] <= e.high)
    # 332 of 350 expected; E and the gains err together, so that the standard deviation is 0.017
    assert 0.90 <= np.mean(held) <= 0.99


# -- use ---------------------------------------------------------------------------------------


def test_cross_validation_and_calibration_take_priors_synthetic():
    """With an offset error of the data, only a narrow prior keeps the gain."""
    data = synthetic(single(), ["gain"], {"gain": 1.05})
    held, free = (
        cross_validate(fit(single(), data, [gain]), data, folds=2).score.rmse
        for gain in (Prior("gain", 1e-7), "gain")
    )
    assert held > 10 * free


def test_default_priors_are_those_of_the_page():
    robot = bs.load_robot("crl-ftdcr-v4")
    names = [E, "gain.tendons.4", "offset", "backlash", "delay", "base", "tool"]
    names += ["hole_angle.segments.1", "pitch_radius", "segments.2.tendons.first_angle"]
    found = default_priors(robot, [*names, "segments.0.tendons.pitch_radius"])
    turned = 2e-4 / 4.5e-3
    assert found == pytest.approx(
        {
            "gain.tendons.4": 0.02,
            "offset": 5e-4,
            "backlash": 1e-4,
            "delay": 0.1,
            "hole_angle.segments.1": turned,
            "pitch_radius": turned,
            "segments.2.tendons.first_angle": turned,
            "segments.0.tendons.pitch_radius": 2e-4,
        }
    )


def test_a_prior_of_a_group_is_of_its_members():
    robot, E1 = bs.load_robot("crl-ftdcr-v4"), "segments.1.backbone.E"
    parameters = [Prior("gain.segments", 0.1), "base.x", Prior(E1, 1e9), Prior("pitch_radius")]
    found = deviations_of(robot, parameters, by_tension=False)
    gains = {f"gain.segments.{i}": 0.1 for i in range(3)}
    assert found == gains | {E1: 1e9, "pitch_radius": 2e-4 / 4.5e-3}
    unknowns = Unknowns(robot, [*gains, "base.x", E1, "pitch_radius"])
    priors = Priors.of(unknowns, unknowns, found)
    assert priors.known.tolist() == [True, True, True, False, True, True] and priors.free == 1
    names = ["base.x", E1]
    assert with_priors(names, found) == ["base.x", Prior(E1, 1e9)]


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        (lambda: Prior("gian", 0.1), "there is no parameter 'gian'"),
        (lambda: Prior("base.x", 0.1), "parameter base.x is named twice"),
        (lambda: Prior("gain", 0.0), "prior of gain is 0.0, it must be a standard deviation above"),
        (lambda: Prior("gain", "2 %"), "prior of gain is '2 %', it must be a standard deviation"),
        (lambda: Prior("gain", np.nan), "prior of gain is nan"),
        (lambda: Prior("gain", np.inf), "prior of gain is inf"),
        (lambda: Prior(E), "segments.0.backbone.E has no default prior"),
        (lambda: Prior("offset"), "offset has no default prior"),  # of tensions
    ],
)
def test_bad_priors_are_named(parameter, words):
    data = Data(points=np.ones((33, 3)), tensions=masses())
    refused(words, lambda: fit(single(), data, ["base", parameter()]))


def test_a_prior_of_several_units_is_refused():
    data = Data(points=np.ones((33, 3)), tensions=masses())
    words = "prior of base is for several parameters with different units; name each: base.x"
    refused(words, lambda: fit(single(), data, [Prior("base", 1.0)]))


def test_priors_hold_from_each_start():
    """Starts have their own natural steps."""
    data = synthetic(single(), [E], {E: 33e9})
    found = fit_from([{E: 1e6}, {E: 33e9}], single(), data, [Prior(E, 1e7)])
    alone = fit(single(), data, [Prior(E, 1e7)], start={E: 33e9})
    assert found[E].value == pytest.approx(alone[E].value, rel=1e-6)
    assert found[E].prior_mean == alone[E].prior_mean and found[E].prior_sd == alone[E].prior_sd
    assert found.evaluations > alone.evaluations
