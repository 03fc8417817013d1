//! How light is solved, as operators see and change it: [`SolverWish`], behind `/solver` of the operators' port.
//!
//! A wish is the text of `[engine.solver]` in part: what it names changes, the rest stays. It is checked before it is taken,
//! and the engine hears of it at its next tick.

use earthshine_engine::SolverConfig;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Longest wish, bytes.
pub(crate) const WISH_BYTES_MAX: usize = 4096;

/// The settings in use, and whether the engine has heard of them.
#[derive(Debug)]
pub(crate) struct SolverWish(Mutex<Wish>);

#[derive(Debug)]
struct Wish {
    solver: SolverConfig,
    is_new: bool,
}

impl SolverWish {
    /// What the engine was made with.
    pub(crate) fn new(solver: SolverConfig) -> Self {
        Self(Mutex::new(Wish { solver, is_new: false }))
    }

    fn lock(&self) -> MutexGuard<'_, Wish> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The settings, whether the engine has heard of them or not.
    pub(crate) fn newest(&self) -> SolverConfig {
        self.lock().solver.clone()
    }

    /// The settings as the text of `[engine.solver]`.
    pub(crate) fn text(&self) -> String {
        toml::to_string(&self.lock().solver).expect("settings are numbers and names")
    }

    /// Changes what `text` names. Returns all settings, or what is wrong with the text: then nothing changes.
    pub(crate) fn change(&self, text: &str) -> Result<String, String> {
        let named: toml::Table = toml::from_str(text).map_err(|error| error.to_string())?;
        let mut wish = self.lock();
        let mut all = toml::Table::try_from(&wish.solver).expect("settings are a table");
        all.extend(named);
        let solver: SolverConfig = all.try_into().map_err(|error: toml::de::Error| error.to_string())?;
        solver.validate().map_err(|error| error.to_string())?;
        *wish = Wish { solver, is_new: true };
        drop(wish);
        Ok(self.text())
    }

    /// The newest settings, if the engine has not heard of them.
    pub(crate) fn take(&self) -> Option<SolverConfig> {
        let mut wish = self.lock();
        std::mem::take(&mut wish.is_new).then(|| wish.solver.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_radiosity::solver::Method;

    #[test]
    fn a_wish_changes_what_it_names_once() {
        let wish = SolverWish::new(SolverConfig::default());
        assert_eq!(wish.take(), None);
        let text = wish.change("by_level = [\"hybrid\", \"matrix\"]\nsamples_per_row = 16").unwrap();
        assert_eq!(text, wish.text());
        let expected = SolverConfig {
            by_level: vec![Method::Hybrid, Method::Matrix],
            samples_per_row: 16,
            ..SolverConfig::default()
        };
        assert_eq!(toml::from_str::<SolverConfig>(&text).unwrap(), expected);
        assert_eq!(wish.take(), Some(expected));
        assert_eq!(wish.take(), None);
    }

    #[test]
    fn wishes_that_cannot_be_are_refused_by_name() {
        let wish = SolverWish::new(SolverConfig::default());
        for (text, words) in [
            ("by_level = [\"radiosity\"]", "radiosity"),
            ("samples = 3", "samples"),
            ("samples_per_row = 0", "solver.samples_per_row"),
            ("history_weight = 1.0", "solver.history_weight"),
            ("by_level = ", "line 1"),
        ] {
            let cause = wish.change(text).unwrap_err();
            assert!(cause.contains(words), "{text}: {cause}");
        }
        assert_eq!(wish.take(), None);
        assert_eq!(toml::from_str::<SolverConfig>(&wish.text()).unwrap(), SolverConfig::default());
    }
}
