//! Where the camera is at a time.

use earthshine_client::Camera;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A camera's way through a world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Path {
    /// Round and round, looking at the middle.
    Orbit {
        /// What is looked at, m.
        centre: Vec3,
        /// m.
        radius: f32,
        /// Of the camera above the centre, m.
        height: f32,
        /// Of one round, s.
        period_s: f32,
    },
    /// To and fro, looking ahead.
    Line {
        /// Start, m.
        from: Vec3,
        /// Where it turns round, m.
        to: Vec3,
        /// m/s.
        speed: f32,
    },
    /// Straight from key to key; it stays at the last one.
    Recorded {
        /// Ascending in time.
        keys: Vec<Key>,
    },
    /// Jumps to random places, and rests at each.
    Teleports {
        /// Same seed, same places.
        seed: u64,
        /// Lower corner of where to, m.
        bounds_min: Vec3,
        /// Upper corner of where to, m.
        bounds_max: Vec3,
        /// Rest at a place, s.
        every_s: f32,
    },
}

/// Where a recorded camera was at one time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// s.
    pub time_s: f32,
    /// m.
    pub position: Vec3,
    /// Any length but zero.
    pub forward: Vec3,
}

/// A path that cannot be flown or read.
#[derive(Debug, thiserror::Error)]
pub enum PathError {
    /// A number that makes no sense.
    #[error("the path cannot be flown: {cause}")]
    Invalid {
        /// Which, and why.
        cause: String,
    },
    /// The file cannot be read.
    #[error("path file {file:?}: {cause}")]
    Read {
        /// Which.
        file: std::path::PathBuf,
        /// What the system says.
        #[source]
        cause: std::io::Error,
    },
    /// The file cannot be written.
    #[error("path file {file:?}: {cause}")]
    Write {
        /// Which.
        file: std::path::PathBuf,
        /// What the system says.
        #[source]
        cause: std::io::Error,
    },
    /// The file's contents are no path.
    #[error("path file {file:?} is no camera path: {cause}")]
    Format {
        /// Which.
        file: std::path::PathBuf,
        /// What is wrong, and where.
        cause: String,
    },
    /// The file's name says neither JSON nor TOML.
    #[error("path file {file:?}: its name must end in .json or .toml")]
    Extension {
        /// Which.
        file: std::path::PathBuf,
    },
}

impl Path {
    /// Most keys of a recording: three hours at 100 Hz.
    pub const KEYS_MAX: usize = 1 << 20;

    /// Checks all numbers.
    ///
    /// # Errors
    /// [`PathError::Invalid`] names the first that makes no sense.
    pub fn validate(&self) -> Result<(), PathError> {
        let fault = |cause: String| Err(PathError::Invalid { cause });
        let positive = |value: f32| value.is_finite() && value > 0.0;
        match self {
            Self::Orbit { centre, radius, height, period_s } => {
                if !(centre.is_finite() && height.is_finite() && positive(*radius) && positive(*period_s)) {
                    return fault(
                        "an orbit needs a finite centre and height, a positive radius and period".into(),
                    );
                }
            }
            Self::Line { from, to, speed } => {
                let has_length = from.is_finite() && to.is_finite() && (*to - *from).length() > 1e-3;
                if !(has_length && positive(*speed)) {
                    return fault("a line needs two different finite ends and a positive speed".into());
                }
            }
            Self::Teleports { bounds_min, bounds_max, every_s, .. } => {
                let is_box = bounds_min.is_finite() && bounds_max.is_finite();
                if !(is_box && bounds_min.cmple(*bounds_max).all() && positive(*every_s)) {
                    return fault(
                        "teleports need finite bounds, min below max, and a positive every_s".into(),
                    );
                }
            }
            Self::Recorded { keys } => {
                if keys.is_empty() || keys.len() > Self::KEYS_MAX {
                    return fault(format!("a recording needs 1 to {} keys", Self::KEYS_MAX));
                }
                for (index, key) in keys.iter().enumerate() {
                    let is_later = index == 0 || key.time_s > keys[index - 1].time_s;
                    if !(is_later && key.time_s.is_finite() && key.position.is_finite()) {
                        return fault(format!("key {index}: times must ascend, and all numbers be finite"));
                    }
                    if key.forward.try_normalize().is_none() {
                        return fault(format!("key {index}: forward must have a length"));
                    }
                }
            }
        }
        Ok(())
    }

    /// The camera `time_s` after the start.
    #[must_use]
    pub fn camera(&self, time_s: f32) -> Camera {
        match self {
            Self::Orbit { centre, radius, height, period_s } => {
                let (sin, cos) = (std::f32::consts::TAU * time_s / period_s).sin_cos();
                let position = *centre + Vec3::new(radius * cos, *height, radius * sin);
                let speed = std::f32::consts::TAU / period_s * radius;
                let forward = (*centre - position).normalize_or(Vec3::NEG_Z);
                Camera { position, forward, velocity: Vec3::new(-sin, 0.0, cos) * speed }
            }
            Self::Line { from, to, speed } => {
                let length = (*to - *from).length();
                let direction = (*to - *from).normalize_or(Vec3::NEG_Z);
                let along = (time_s * speed).rem_euclid(2.0 * length);
                let (along, ahead) =
                    if along <= length { (along, direction) } else { (2.0 * length - along, -direction) };
                Camera { position: *from + direction * along, forward: ahead, velocity: ahead * *speed }
            }
            Self::Recorded { keys } => recorded(keys, time_s),
            Self::Teleports { seed, bounds_min, bounds_max, .. } => {
                let jump = self.jump(time_s);
                let position = *bounds_min + (*bounds_max - *bounds_min) * random(*seed, 2 * jump);
                let level = random(*seed, 2 * jump + 1) - 0.5;
                let forward = Vec3::new(level.x, 0.25 * level.y, level.z).normalize_or(Vec3::NEG_Z);
                Camera { position, forward, velocity: Vec3::ZERO }
            }
        }
    }

    /// How often the camera has jumped until `time_s`; 0 for paths that do not jump.
    #[must_use]
    pub fn jump(&self, time_s: f32) -> u64 {
        match self {
            Self::Teleports { every_s, .. } => (time_s / every_s).max(0.0) as u64,
            _ => 0,
        }
    }
}

fn recorded(keys: &[Key], time_s: f32) -> Camera {
    let after = keys.partition_point(|key| key.time_s <= time_s);
    let at = |key: &Key, velocity| Camera {
        position: key.position,
        forward: key.forward.normalize_or(Vec3::NEG_Z),
        velocity,
    };
    let rest = Camera { position: Vec3::ZERO, forward: Vec3::NEG_Z, velocity: Vec3::ZERO };
    let (Some(a), Some(b)) = (after.checked_sub(1).and_then(|before| keys.get(before)), keys.get(after))
    else {
        // Before the first or after the last.
        return keys.get(after).or(keys.last()).map_or(rest, |key| at(key, Vec3::ZERO));
    };
    let span_s = b.time_s - a.time_s;
    let share = (time_s - a.time_s) / span_s;
    let forward = at(a, Vec3::ZERO).forward.lerp(at(b, Vec3::ZERO).forward, share);
    Camera {
        position: a.position.lerp(b.position, share),
        forward: forward.normalize_or(a.forward.normalize_or(Vec3::NEG_Z)),
        velocity: (b.position - a.position) / span_s,
    }
}

/// Three numbers in `[0, 1)` from (seed, index): the finaliser of `SplitMix64`, 21 bits an axis.
fn random(seed: u64, index: u64) -> Vec3 {
    let mut z = (seed ^ index.wrapping_mul(0x9E37_79B9_7F4A_7C15)).wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^= z >> 31;
    let axis = |shift: u32| (z >> shift & 0x1F_FFFF) as f32 / (1 << 21) as f32;
    Vec3::new(axis(0), axis(21), axis(42))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn orbit() -> Path {
        Path::Orbit { centre: Vec3::new(1.0, 2.0, 3.0), radius: 5.0, height: 1.0, period_s: 10.0 }
    }

    fn line() -> Path {
        Path::Line { from: Vec3::ZERO, to: Vec3::new(3.0, 0.0, 4.0), speed: 2.0 }
    }

    fn recording() -> Path {
        let key = |time_s, x| Key { time_s, position: Vec3::X * x, forward: Vec3::new(1.0, 0.0, x) };
        Path::Recorded { keys: vec![key(1.0, 0.0), key(2.0, 4.0), key(4.0, 0.0)] }
    }

    #[test]
    fn velocities_are_derivatives_and_forwards_are_unit() {
        for path in [orbit(), line(), recording()] {
            path.validate().unwrap();
            for time_s in [1.13f32, 1.7, 2.21, 3.3] {
                let step = 1e-2;
                let (before, after) = (path.camera(time_s - step), path.camera(time_s + step));
                let slope = (after.position - before.position) / (2.0 * step);
                let camera = path.camera(time_s);
                assert!((camera.velocity - slope).length() < 1e-2, "{path:?} at {time_s}: {slope}");
                assert!((camera.forward.length() - 1.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn a_line_turns_round_and_a_recording_stays() {
        assert!(line().camera(2.5).position.distance(Vec3::new(3.0, 0.0, 4.0)) < 1e-5);
        assert!(line().camera(5.0).position.length() < 1e-5);
        assert!(line().camera(4.0).velocity.dot(Vec3::new(3.0, 0.0, 4.0)) < 0.0);
        let last = recording().camera(99.0);
        assert_eq!((last.position, last.velocity), (Vec3::ZERO, Vec3::ZERO));
        assert_eq!(recording().camera(0.0).position, Vec3::ZERO);
    }

    #[test]
    fn teleports_rest_jump_and_repeat() {
        let (low, high) = (Vec3::new(-9.0, 1.0, 0.0), Vec3::new(9.0, 2.0, 30.0));
        let path = Path::Teleports { seed: 5, bounds_min: low, bounds_max: high, every_s: 2.0 };
        path.validate().unwrap();
        assert_eq!(path.camera(2.0), path.camera(3.9));
        assert_ne!(path.camera(1.9).position, path.camera(2.0).position);
        assert_eq!((path.jump(1.9), path.jump(2.0), orbit().jump(50.0)), (0, 1, 0));
        let mean = (0..1000).map(|jump| path.camera(jump as f32 * 2.0).position).sum::<Vec3>() / 1000.0;
        assert!(((mean - low) / (high - low) - 0.5).abs().max_element() < 0.05, "{mean}");
        for jump in 0..1000 {
            let position = path.camera(jump as f32 * 2.0).position;
            assert!(position.cmpge(low).all() && position.cmple(high).all());
        }
    }

    #[test]
    fn impossible_paths_are_named() {
        let fault = |path: Path| path.validate().unwrap_err().to_string();
        assert!(
            fault(Path::Orbit { centre: Vec3::ZERO, radius: 0.0, height: 0.0, period_s: 1.0 })
                .contains("orbit")
        );
        assert!(fault(Path::Line { from: Vec3::ONE, to: Vec3::ONE, speed: 1.0 }).contains("line"));
        assert!(fault(Path::Recorded { keys: vec![] }).contains("keys"));
        let key = Key { time_s: 1.0, position: Vec3::ZERO, forward: Vec3::X };
        assert!(fault(Path::Recorded { keys: vec![key, key] }).contains("key 1"));
        assert!(fault(Path::Recorded { keys: vec![Key { forward: Vec3::ZERO, ..key }] }).contains("forward"));
        let nan = Path::Teleports { seed: 0, bounds_min: Vec3::NAN, bounds_max: Vec3::ONE, every_s: 1.0 };
        assert!(fault(nan).contains("teleports"));
    }
}
