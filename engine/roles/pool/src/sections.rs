//! The sections `timeouts` and `faults` of an experiment file, used unchanged from the file to the scheduler. Their
//! defaults are defined here; Python's model of the file reads the defaults, and adds limits and descriptions for
//! users.

use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Time limits. In files and in Python: seconds, greater than 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Timeouts {
    /// How long to try to connect; may be 0. Used by the caller only, since a pool tries once.
    #[serde(with = "seconds_or_zero")]
    pub connect: Duration,
    /// How long to wait for a fitting server at the start.
    #[serde(with = "seconds")]
    pub discovery: Duration,
    /// How long to wait for the next message of a server in an episode; also, how long work waits for any server.
    #[serde(with = "seconds")]
    pub step: Duration,
    /// Shortest silence after which a server is a straggler; the silence must also be much longer than ever before.
    #[serde(with = "seconds")]
    pub least: Duration,
    /// How long a whole stepwise episode may take.
    #[serde(with = "seconds")]
    pub episode: Duration,
    /// Keep-alive interval of the connection to the broker in seconds; `None` for that of the connection's settings.
    /// Used by the caller only, like `connect`.
    pub keep_alive: Option<u16>,
}

impl Timeouts {
    /// Returns a hint for the end of a message, in case a server silent for longer than `step` is only slow.
    #[must_use]
    pub fn step_hint(&self) -> String {
        hint("step", self.step)
    }

    /// Returns the same hint for `episode`.
    #[must_use]
    pub fn episode_hint(&self) -> String {
        hint("episode", self.episode)
    }
}

fn hint(key: &str, value: Duration) -> String {
    format!(
        "if the simulation needs longer, raise timeouts.{key} ({} s)",
        value.as_secs_f64()
    )
}

impl Default for Timeouts {
    fn default() -> Self {
        Self {
            connect: Duration::ZERO,
            discovery: Duration::from_secs(10),
            step: Duration::from_secs(60),
            least: Duration::from_secs(1),
            episode: Duration::from_secs(86_400),
            keep_alive: None,
        }
    }
}

/// Treatment of failing, slow and wrong servers and evaluations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Faults {
    /// Largest number of attempts per evaluation; attempts together with other evaluations do not count.
    #[serde(deserialize_with = "positive")]
    pub attempts: u32,
    /// Number of servers that fail with a single evaluation before the evaluation is quarantined.
    #[serde(deserialize_with = "positive")]
    pub quarantine: u32,
    /// Whether an idle server gets a copy of the work of a slow or silent one.
    pub backup: bool,
    /// Share of the evaluations that are repeated on another server, from 0 to 1.
    #[serde(deserialize_with = "share")]
    pub audit: f64,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            attempts: 3,
            quarantine: 3,
            backup: true,
            audit: 0.0,
        }
    }
}

/// Serialization of a duration in seconds.
mod seconds_or_zero {
    use std::time::Duration;

    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(value: &Duration, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_f64(value.as_secs_f64())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Duration, D::Error> {
        let value = f64::deserialize(deserializer)?;
        Duration::try_from_secs_f64(value)
            .map_err(|_| D::Error::custom(format!("must be a duration in seconds, not {value}")))
    }
}

/// Serialization of a duration in seconds, greater than 0.
mod seconds {
    use std::time::Duration;

    use serde::{Deserializer, de::Error};

    pub use super::seconds_or_zero::serialize;

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Duration, D::Error> {
        let value = super::seconds_or_zero::deserialize(deserializer)?;
        if value.is_zero() {
            return Err(D::Error::custom("must be larger than 0 seconds"));
        }
        Ok(value)
    }
}

fn positive<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    match u32::deserialize(deserializer)? {
        0 => Err(serde::de::Error::custom("must be at least 1")),
        value => Ok(value),
    }
}

fn share<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let value = f64::deserialize(deserializer)?;
    if (0.0..=1.0).contains(&value) {
        Ok(value)
    } else {
        Err(serde::de::Error::custom(format!(
            "must be a share from 0 to 1, not {value}"
        )))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn what_is_left_out_has_its_default() {
        let timeouts: Timeouts = serde_json::from_value(json!({"step": 0.25})).unwrap();
        assert_eq!(timeouts.step, Duration::from_millis(250));
        assert_eq!(
            timeouts,
            Timeouts {
                step: timeouts.step,
                ..Timeouts::default()
            }
        );
        let faults: Faults = serde_json::from_value(json!({"audit": 1})).unwrap();
        assert!(faults.audit >= 1.0 && faults.attempts == Faults::default().attempts);
    }

    #[test]
    fn what_is_written_reads_back() {
        let timeouts = serde_json::to_value(Timeouts::default()).unwrap();
        assert_eq!(timeouts["episode"], json!(86_400.0));
        assert_eq!(
            serde_json::from_value::<Timeouts>(timeouts).unwrap(),
            Timeouts::default()
        );
    }

    #[test]
    fn wrong_values_are_refused() {
        for (wrong, expected) in [
            (json!({"step": 0}), "larger than 0"),
            (
                json!({"least": -1.5}),
                "must be a duration in seconds, not -1.5",
            ),
            (json!({"pause": 1}), "unknown field `pause`"),
        ] {
            let error = serde_json::from_value::<Timeouts>(wrong).unwrap_err();
            assert!(error.to_string().contains(expected), "{error}");
        }
        for (wrong, expected) in [
            (json!({"attempts": 0}), "at least 1"),
            (json!({"quarantine": -1}), "invalid value"),
            (
                json!({"audit": 1.01}),
                "must be a share from 0 to 1, not 1.01",
            ),
        ] {
            let error = serde_json::from_value::<Faults>(wrong).unwrap_err();
            assert!(error.to_string().contains(expected), "{error}");
        }
    }
}
