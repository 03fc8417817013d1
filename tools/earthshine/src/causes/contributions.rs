//! Signed parts of one error, one a cause; they add up to the error.

use super::Cause;

/// What each cause adds to the light at a point, channels averaged, lx.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Contributions([f64; Cause::COUNT]);

impl Contributions {
    /// Adds to one cause.
    pub(crate) fn add(&mut self, cause: Cause, light: f64) {
        self.0[cause as usize] += light;
    }

    /// Adds `light` to `inside` as far as it is within `+-limit`, the rest to `beyond`.
    pub(crate) fn add_within(&mut self, inside: Cause, beyond: Cause, light: f64, limit: f64) {
        let within = light.clamp(-limit, limit);
        self.add(inside, within);
        self.add(beyond, light - within);
    }

    /// What one cause adds.
    pub(crate) fn of(&self, cause: Cause) -> f64 {
        self.0[cause as usize]
    }

    /// Their sum.
    #[cfg(test)]
    pub(crate) fn total(&self) -> f64 {
        self.0.iter().sum()
    }

    /// The cause that explains most of `error`: the largest part of its sign.
    pub(crate) fn main_cause(&self, error: f64) -> Cause {
        let explained = |cause: &Cause| self.of(*cause) * error.signum();
        // The first of equals.
        Cause::ALL
            .into_iter()
            .rev()
            .max_by(|a, b| explained(a).total_cmp(&explained(b)))
            .unwrap_or(Cause::Noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_part_of_the_errors_sign_explains_it() {
        let mut parts = Contributions::default();
        parts.add(Cause::ThinWall, 5.0);
        parts.add(Cause::TooFewRays, -7.0);
        parts.add_within(Cause::Noise, Cause::FarLight, -4.0, 1.0);
        assert_eq!((parts.of(Cause::Noise), parts.of(Cause::FarLight)), (-1.0, -3.0));
        assert_eq!(parts.total(), -6.0);
        assert_eq!(parts.main_cause(-6.0), Cause::TooFewRays);
        assert_eq!(parts.main_cause(6.0), Cause::ThinWall);
    }

    #[test]
    fn every_cause_has_its_own_place_and_name() {
        for (index, cause) in Cause::ALL.into_iter().enumerate() {
            assert_eq!(cause as usize, index);
            assert_eq!(serde_json::to_value(cause).unwrap(), cause.name());
        }
    }
}
