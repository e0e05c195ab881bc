//! The sections `timeouts` and `faults` of an experiment file, as they are from the file to the scheduler. Their defaults
//! are here; Python's model of the file takes them from here, and has the limits and the descriptions for users.

use std::time::Duration;

use serde::{Deserialize, Serialize};

/// How long to wait. As text or in Python: seconds, larger than 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Timeouts {
    /// How long to try to connect, which is up to the caller: a pool tries once. May be 0.
    #[serde(with = "seconds_or_zero")]
    pub connect: Duration,
    /// For a fitting server, at the start.
    #[serde(with = "seconds")]
    pub discovery: Duration,
    /// For the next message of a server in an episode; work waits for any server as long, too.
    #[serde(with = "seconds")]
    pub step: Duration,
    /// A server is a straggler when it is silent for much longer than ever before, and for this time at least.
    #[serde(with = "seconds")]
    pub least: Duration,
    /// For a whole stepwise episode.
    #[serde(with = "seconds")]
    pub episode: Duration,
    /// Keep-alive interval of the connection to the broker, seconds; None = that of the connection's settings. For the caller,
    /// as `connect` is.
    pub keep_alive: Option<u16>,
}

impl Timeouts {
    /// What helps where a server was silent for longer than `step`, but only slow: the end of a message.
    #[must_use]
    pub fn step_hint(&self) -> String {
        hint("step", self.step)
    }

    /// The same for `episode`.
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

/// How failing, slow and wrong servers and evaluations are treated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Faults {
    /// How often an evaluation is tried, at most; tries together with other evaluations do not count.
    #[serde(deserialize_with = "positive")]
    pub attempts: u32,
    /// After how many servers that went down with nothing but one evaluation no other server gets it.
    #[serde(deserialize_with = "positive")]
    pub quarantine: u32,
    /// Whether an idle server gets a copy of what a slow or silent one has.
    pub backup: bool,
    /// The share of evaluations that are repeated on another server, 0 to 1.
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

/// A duration in seconds.
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

/// A duration in seconds that is not zero.
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
