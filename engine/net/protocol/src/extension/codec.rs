//! Codec of extension messages.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{EXTENSION_VERSION, Envelope, MAX_BLOCK, ToServer, ToTool, reader, shortened};
use crate::DecodeError;
use crate::place::at;

/// Largest number of characters of a metric's name in messages.
const MOST_NAME: usize = 100;

fn decode<T: DeserializeOwned>(payload: &[u8]) -> Result<T, DecodeError> {
    if payload.len() > MAX_BLOCK {
        return Err(DecodeError::value(format!(
            "{} bytes are more than the {MAX_BLOCK} that a block may have",
            payload.len()
        )));
    }
    reader::read(payload).map_err(|mismatch| {
        let words = at(&mismatch.path, &mismatch.reason);
        DecodeError::value(format!("no message of this extension: {words}"))
    })
}

/// The kind alone, read first so that the message is then decoded directly into its type.
#[derive(Deserialize)]
struct Kind {
    kind: String,
}

fn unknown(kind: &str, expected: &str) -> DecodeError {
    DecodeError::value(format!("\"kind\" is {kind:?}, expected {expected}"))
}

/// Encodes a message. `numbers`: size in bytes of its arrays, to avoid reallocations.
fn encode<T: Serialize>(message: &T, numbers: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(numbers + 1024);
    // Maps, texts and numbers cannot fail to serialize into memory.
    match rmp_serde::encode::write_named(&mut bytes, message) {
        Ok(()) => bytes,
        Err(_) => Vec::new(),
    }
}

fn check(version: u64) -> Result<(), DecodeError> {
    if version == EXTENSION_VERSION {
        Ok(())
    } else {
        Err(DecodeError::value(format!(
            "\"version\" is {version}, expected {EXTENSION_VERSION}"
        )))
    }
}

fn shape(name: &str, count: usize, expected: usize) -> Result<(), DecodeError> {
    if count == expected {
        Ok(())
    } else {
        Err(DecodeError::value(format!(
            "\"{name}\" has {count} numbers, expected {expected}"
        )))
    }
}

/// Returns the path of a metric's values.
fn metric(name: &str) -> String {
    format!("metrics.{}", shortened(name.to_owned(), MOST_NAME))
}

fn finite(name: &str, numbers: &[f32]) -> Result<(), DecodeError> {
    // The compiler vectorizes only loops without an early exit.
    let all = |part: &[f32]| {
        let sound = part.iter().map(|number| number.is_finite());
        sound.fold(true, |all, is_finite| all & is_finite)
    };
    if numbers.chunks(1024).all(all) {
        return Ok(());
    }
    match numbers.iter().position(|number| !number.is_finite()) {
        Some(index) => Err(DecodeError::value(format!(
            "\"{name}\"[{index}] is NaN or infinite"
        ))),
        None => Ok(()),
    }
}

impl Envelope {
    /// Decodes a payload; `None` if it lacks one of these fields.
    #[must_use]
    pub fn decode(payload: &[u8]) -> Option<Self> {
        decode(payload).ok()
    }
}

impl ToServer {
    /// Decodes a payload.
    ///
    /// # Errors
    /// Fails if the payload is too large or not a MessagePack map of a known kind and version, or if there are values
    /// that are not finite or no seeds.
    pub fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        let Kind { kind } = decode(payload)?;
        let message = match kind.as_str() {
            "evaluate" => Self::Evaluate(decode(payload)?),
            "start" => Self::Start(decode(payload)?),
            "actuators" => Self::Actuators(decode(payload)?),
            _ => return Err(unknown(&kind, "evaluate, start or actuators")),
        };
        match &message {
            Self::Evaluate(m) => {
                check(m.version)?;
                finite("genomes", &m.genomes.0)?;
                if m.seeds.0.is_empty() {
                    return Err(DecodeError::value("\"seeds\" is empty".to_owned()));
                }
                if !m.lease.is_finite() {
                    return Err(DecodeError::value(format!(
                        "\"lease\" is {}, expected a number of seconds",
                        m.lease
                    )));
                }
                if let Some(sample) = &m.sample {
                    if !m.genomes.0.is_empty() {
                        return Err(DecodeError::value(
                            "\"genomes\" must be empty where there is a \"sample\"".to_owned(),
                        ));
                    }
                    if !sample.fits() {
                        return Err(DecodeError::value(format!(
                            "\"sample.count\" is {}: more genomes than the {MAX_BLOCK} bytes of a message",
                            sample.count
                        )));
                    }
                    if let Some(problem) = sample.problem() {
                        return Err(DecodeError::value(problem));
                    }
                }
            }
            Self::Start(m) => {
                check(m.version)?;
                if m.seeds.0.is_empty() {
                    return Err(DecodeError::value("\"seeds\" is empty".to_owned()));
                }
            }
            Self::Actuators(m) => {
                check(m.version)?;
                finite("actuators", &m.actuators.0)?;
            }
        }
        Ok(message)
    }

    /// Encodes the payload.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let numbers = match self {
            Self::Evaluate(m) => size_of_val(&m.genomes.0[..]) + size_of_val(&m.seeds.0[..]),
            Self::Start(m) => size_of_val(&m.seeds.0[..]),
            Self::Actuators(m) => size_of_val(&m.actuators.0[..]),
        };
        encode(self, numbers)
    }
}

impl ToTool {
    /// Decodes a payload.
    ///
    /// # Errors
    /// Fails if the payload is too large or not a MessagePack map of a known kind and version, if the arrays do not
    /// match, or if the fitness of an episode not in `failed` is not finite.
    pub fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        let Kind { kind } = decode(payload)?;
        let message = match kind.as_str() {
            "evaluated" => Self::Evaluated(decode(payload)?),
            "sensors" => Self::Sensors(decode(payload)?),
            "failed" => Self::Failed(decode(payload)?),
            "scene" => Self::Scene(Box::new(decode(payload)?)),
            _ => return Err(unknown(&kind, "evaluated, sensors, failed or scene")),
        };
        match &message {
            Self::Evaluated(m) => {
                check(m.version)?;
                for (name, values) in &m.metrics {
                    shape(&metric(name), values.0.len(), m.fitness.0.len())?;
                }
                let bad = m
                    .fitness
                    .0
                    .iter()
                    .filter(|fitness| !fitness.is_finite())
                    .count();
                if bad != m.failed.len() {
                    return Err(DecodeError::value(format!(
                        "\"fitness\" has {bad} values that are NaN or infinite, but \"failed\" has {} episodes",
                        m.failed.len()
                    )));
                }
            }
            Self::Sensors(m) => {
                check(m.version)?;
                shape("agents", m.agents.0.len(), m.episodes.0.len())?;
                shape("fitness", m.fitness.0.len(), m.ended.0.len())?;
                for (name, values) in &m.metrics {
                    shape(&metric(name), values.0.len(), m.ended.0.len())?;
                }
                finite("sensors", &m.sensors.0)?;
                if let Some(index) = m.fitness.0.iter().position(|number| !number.is_finite()) {
                    return Err(DecodeError::value(format!(
                        "\"fitness\"[{index}] is NaN or infinite"
                    )));
                }
            }
            Self::Failed(m) => check(m.version)?,
            Self::Scene(m) => {
                check(m.version)?;
                m.check()?;
            }
        }
        Ok(message)
    }

    /// Returns the server and the request named in a payload that cannot be decoded otherwise, if it names them.
    #[must_use]
    pub fn answered(payload: &[u8]) -> Option<(u64, u64)> {
        #[derive(Deserialize)]
        struct Answered {
            server: u64,
            request: u64,
        }
        let Answered { server, request } = decode(payload).ok()?;
        Some((server, request))
    }

    /// Encodes the payload.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let numbers = match self {
            Self::Evaluated(m) => size_of_val(&m.fitness.0[..]) * (1 + m.metrics.len()),
            Self::Sensors(m) => size_of_val(&m.sensors.0[..]) + 8 * m.agents.0.len(),
            Self::Failed(_) => 0,
            Self::Scene(m) => m.numbers(),
        };
        encode(self, numbers)
    }
}
