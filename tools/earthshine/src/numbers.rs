//! Numbers on the command line that have a range: clap takes `nan` and `-1` for any `f32`.

/// Noise at which a reference stops, as a share of the light: finite, zero or more.
///
/// # Errors
/// What it may be.
pub(crate) fn noise(text: &str) -> Result<f32, String> {
    match text.trim().parse::<f32>() {
        Ok(noise) if noise.is_finite() && noise >= 0.0 => Ok(noise),
        Ok(_) => Err("it must be a share of the light, 0 or more: 0.01 is 1 %".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

/// What must be above zero and finite.
///
/// # Errors
/// What it may be.
pub(crate) fn positive(text: &str) -> Result<f32, String> {
    match text.trim().parse::<f32>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        Ok(_) => Err("it must be above 0 and finite".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

/// A share between zero and one, without either.
///
/// # Errors
/// What it may be.
pub(crate) fn share(text: &str) -> Result<f32, String> {
    match text.trim().parse::<f32>() {
        Ok(share) if share > 0.0 && share < 1.0 => Ok(share),
        Ok(_) => Err("it must be above 0 and below 1".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_or_out_of_range_is_refused() {
        assert_eq!(
            (noise("0"), noise("0.02"), positive("1e-3"), share("0.5")),
            (Ok(0.0), Ok(0.02), Ok(1e-3), Ok(0.5))
        );
        for text in ["nan", "-1", "inf", "", "many"] {
            assert!(noise(text).is_err() && positive(text).is_err() && share(text).is_err(), "{text}");
        }
        assert!(positive("0").is_err() && share("0").is_err() && share("1").is_err());
    }
}
