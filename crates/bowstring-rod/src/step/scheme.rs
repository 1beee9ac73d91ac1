//! Weights of the time integration: the first-order generalised-alpha method (theory Eq. 5.2;
//! Jansen, Whiting and Hulbert 2000) with physical damping.
//!
//! Theory: docs/theory/dynamics.md.

/// Physical damping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damping {
    /// Mass-proportional (Rayleigh) damping: force per mass and velocity, on all mass and inertia
    /// (1/s).
    pub mass: f64,
    /// Kelvin-Voigt damping: stress due to the strain rate over stress due to the strain (s).
    pub material: f64,
}

/// Largest fraction of its velocity that restoring the energy removes in a step.
const MAX_RESTORING: f64 = 1e-2;

/// Time-integration scheme of the present step.
pub(super) struct Scheme {
    /// Weights alpha_m, alpha_f and gamma of the generalised-alpha method (theory Eq. 5.2).
    pub am: f64,
    pub af: f64,
    pub gamma: f64,
    /// Length of the step (s); infinite in a search for an equilibrium.
    pub duration: f64,
    pub damping: Damping,
    /// Mass-proportional damping that restores the energy in this step (1/s).
    restoring: f64,
    /// Whether the scheme has no rate and acceleration of an earlier step.
    pub fresh: bool,
    /// Whether shear and extension only regularise (Kirchhoff rod).
    pub rigid: bool,
}

impl Scheme {
    pub fn new(damping: Damping, rigid: bool) -> Self {
        Scheme {
            am: 0.5,
            af: 0.5,
            gamma: 0.5,
            duration: 0.0,
            damping,
            restoring: 0.0,
            fresh: true,
            rigid,
        }
    }

    /// Prepares a step with the spectral radius `rho` at infinite frequency (theory Eq. 5.2), from
    /// 0 (strongest numerical damping) to 1 (none). Without memory there is no numerical damping.
    #[inline(always)]
    pub fn begin(&mut self, duration: f64, rho: f64) {
        let rho = if self.fresh { 1.0 } else { rho };
        self.am = 0.5 * (3.0 - rho) / (1.0 + rho);
        self.af = 1.0 / (1.0 + rho);
        self.gamma = 0.5 + self.am - self.af;
        self.duration = duration;
        self.restoring = 0.0;
    }

    /// Prepares a search for an equilibrium: a step without inertia.
    pub fn begin_at_rest(&mut self) {
        self.duration = f64::INFINITY;
        self.restoring = 0.0;
        (self.am, self.af, self.gamma) = (1.0, 1.0, 1.0);
    }

    /// Derivative of the rate with respect to the change over the step, `1 / (gamma h)` (1/s).
    #[inline(always)]
    pub fn rate_by_change(&self) -> f64 {
        1.0 / (self.gamma * self.duration)
    }

    /// Weight of the earlier rate in the rate where forces balance, `1 - am / gamma`.
    #[inline(always)]
    pub fn memory(&self) -> f64 {
        1.0 - self.am / self.gamma
    }

    /// Effective stiffness of this step over the elastic stiffness.
    #[inline(always)]
    pub fn strain_factor(&self) -> f64 {
        1.0 + self.damping.material * self.am / (self.gamma * self.duration * self.af)
    }

    /// The same for shear and extension; in a Kirchhoff rod they only regularise and are not
    /// damped.
    #[inline(always)]
    pub fn force_factor(&self) -> f64 {
        if self.rigid {
            1.0
        } else {
            self.strain_factor()
        }
    }

    /// Fraction of the step where the contact forces are evaluated. In a Kirchhoff rod they are
    /// constraint forces, which are defined only where forces balance.
    #[inline(always)]
    pub fn force_share(&self) -> f64 {
        if self.rigid {
            1.0
        } else {
            self.af
        }
    }

    /// Derivative of the acceleration, damping included, with respect to the displacement in this
    /// step (1/s^2); zero in a search for an equilibrium.
    #[inline(always)]
    pub fn acceleration_by_distance(&self) -> f64 {
        let per = self.rate_by_change();
        let damping = self.damping.mass + self.restoring;
        (self.am * per / self.af + if per > 0.0 { damping } else { 0.0 }) * self.am * per
    }

    /// Coefficient of the mass in the tangent (1/s^2).
    #[inline(always)]
    pub fn tangent_inertia(&self) -> f64 {
        self.acceleration_by_distance() / self.af
    }

    /// Sets the mass-proportional damping that removes the energy excess when the step is solved
    /// again; returns whether that changes the step. `loss_by_rate` (J s) is zero where nothing
    /// moves.
    pub fn restore(&mut self, excess: f64, loss_by_rate: f64) -> bool {
        let most = MAX_RESTORING / self.duration;
        let requested = self.restoring + excess / loss_by_rate;
        // division by zero motion gives a NaN or an infinity
        let restoring = if requested.is_finite() {
            requested.clamp(-most, most)
        } else {
            self.restoring
        };
        let changes = restoring != self.restoring;
        self.restoring = restoring;
        changes
    }
}
