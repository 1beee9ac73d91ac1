//! Weights of the time integration: the first-order generalised-alpha method (Jansen, Whiting and
//! Hulbert 2000) with physical damping.

/// Physical damping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damping {
    /// Mass-proportional damping: force per mass and velocity, on all mass and inertia (1/s).
    pub mass: f64,
    /// Kelvin-Voigt damping: stress of the strain's rate over that of the strain (s).
    pub material: f64,
}

/// Largest share of its velocity that restoring the energy takes from the mass in a step.
const MAX_RESTORING: f64 = 1e-2;

/// The time-integration scheme of the present step.
pub(super) struct Scheme {
    /// Weights of the generalised-alpha method.
    pub am: f64,
    pub af: f64,
    pub gamma: f64,
    /// Length of the step, s; infinite in a search for an equilibrium.
    pub duration: f64,
    pub damping: Damping,
    /// Mass damping that restores the energy in this step, 1/s.
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

    /// Prepares a step by the spectral radius at infinite frequency: 1 damps nothing, 0 all at once.
    /// Without memory there is no numerical damping.
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

    /// Rate by change over the step, `1 / (gamma h)`, 1/s.
    #[inline(always)]
    pub fn rate_by_change(&self) -> f64 {
        1.0 / (self.gamma * self.duration)
    }

    /// Share of the earlier rate in the rate where forces balance, `1 - am / gamma`.
    #[inline(always)]
    pub fn memory(&self) -> f64 {
        1.0 - self.am / self.gamma
    }

    /// Stiffness of this step over the elastic one.
    #[inline(always)]
    pub fn strain_factor(&self) -> f64 {
        1.0 + self.damping.material * self.am / (self.gamma * self.duration * self.af)
    }

    /// The same for shear and extension, which a Kirchhoff rod has too little of to damp.
    #[inline(always)]
    pub fn force_factor(&self) -> f64 {
        if self.rigid {
            1.0
        } else {
            self.strain_factor()
        }
    }

    /// Fraction of the step where the contact forces are taken. Those of a Kirchhoff rod hold a
    /// constraint: only where forces balance do they mean anything.
    #[inline(always)]
    pub fn force_share(&self) -> f64 {
        if self.rigid {
            1.0
        } else {
            self.af
        }
    }

    /// Acceleration, damping included, by distance in this step, 1/s^2; zero in a search for an
    /// equilibrium.
    #[inline(always)]
    pub fn acceleration_by_distance(&self) -> f64 {
        let per = self.rate_by_change();
        let damping = self.damping.mass + self.restoring;
        (self.am * per / self.af + if per > 0.0 { damping } else { 0.0 }) * self.am * per
    }

    /// Coefficient of the mass in the tangent, 1/s^2.
    #[inline(always)]
    pub fn tangent_inertia(&self) -> f64 {
        self.acceleration_by_distance() / self.af
    }

    /// Sets the mass damping that takes the excess out of the step once it is solved again; returns
    /// whether that changes the step. `loss_by_rate` (J s): zero where nothing moves.
    pub fn restore(&mut self, excess: f64, loss_by_rate: f64) -> bool {
        let most = MAX_RESTORING / self.duration;
        let wanted = self.restoring + excess / loss_by_rate;
        // nothing that moves gives a NaN or an infinity
        let restoring = if wanted.is_finite() {
            wanted.clamp(-most, most)
        } else {
            self.restoring
        };
        let changes = restoring != self.restoring;
        self.restoring = restoring;
        changes
    }
}
