//! Protocol of the platform: typed messages and their encoding, topics, hashes, and validation.
//!
//! The contract itself is in `protocol/` at the root of the repository; the tests here replay its golden vectors.

use std::borrow::Cow;

use swarmwright_values::plain;

mod extension;
mod hash;
mod messages;
mod numbers;
mod place;
mod presence;
mod readings;
mod status;
mod topics;
mod values;

pub use extension::{
    BatchActuators, BatchSensors, BatchStart, Bodies, EXTENSION_VERSION, Envelope, Evaluate,
    Evaluated, F32s, F64s, Failed, Failure, MAX_BLOCK, MEDIA_TYPE, MOST_REASON, MOST_STACK,
    NO_AGENT, NORMAL, Rays, Refusal, RefusalKind, Sample, SceneLight, SceneMessage, ScenePatch,
    SceneScale, SceneStyle, SceneWall, ToServer, ToTool, U32s, U64s, shortened,
};
pub use hash::EpisodeHasher;
pub use messages::{
    AnnouncedSide, Announcement, Capabilities, Control, Discovery, Message, ModuleCode,
    ParametersMessage, Requirements, SCENE_PARTS, ServerMessage, missing_module,
};
pub use presence::{Presence, State};
pub use readings::{Actuator, Fitness, ReadingWriter, Sensor, SensorReading};
pub use status::{Activity, MOST_LISTED, Missing, NoServer, PieceKind, Status, Used, Waiting};
pub use topics::{Topic, TopicError, Topics};
pub use values::bytes_of;

/// Largest payload in bytes, except for sensor messages; larger ones are refused unread.
pub const MAX_PAYLOAD: usize = 1 << 20;

/// Largest sensor message in bytes; larger ones are refused unread. The sensors of an agent may be a picture or a map.
pub const MAX_SENSOR: usize = MAX_BLOCK;

/// Reasons why a payload is not a valid message of its topic.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// The payload is larger than [`MAX_PAYLOAD`] or [`MAX_SENSOR`].
    #[error("{bytes} bytes are more than the {most} that a message may have")]
    TooLarge {
        /// Size of the payload in bytes.
        bytes: usize,
        /// Largest size in bytes.
        most: usize,
    },
    /// Invalid JSON, or JSON of another shape; with the path and what was expected.
    #[error("{0}")]
    Json(String),
    /// A required key is missing; its path.
    #[error("the required key \"{0}\" is missing")]
    Missing(Cow<'static, str>),
    /// A value has the wrong type or is invalid; with the path and what was expected.
    #[error("{0}")]
    Value(String),
}

/// Largest number of characters of an error message; it may quote the payload, and a peer may send a mebibyte in place
/// of a number.
const MOST_WORDS: usize = 400;

impl DecodeError {
    /// Creates the error for a missing key with this path.
    pub(crate) fn missing(path: impl Into<Cow<'static, str>>) -> Self {
        Self::Missing(path.into())
    }

    /// Creates the error for JSON of another shape.
    pub(crate) fn json(words: impl Into<String>) -> Self {
        Self::Json(shortened(words.into(), MOST_WORDS))
    }

    /// Returns the path of the invalid key without indices of lists; empty for the message as a whole.
    #[must_use]
    pub fn key(&self) -> &str {
        let words = match self {
            Self::TooLarge { .. } => "",
            Self::Missing(path) => path,
            Self::Json(words) | Self::Value(words) => {
                let quoted = words.strip_prefix('"');
                quoted
                    .and_then(|rest| rest.split_once('"'))
                    .map_or("", |(path, _)| path)
            }
        };
        words.split('[').next().unwrap_or_default()
    }

    /// Creates the error for an invalid value.
    pub(crate) fn value(words: impl Into<String>) -> Self {
        Self::Value(shortened(words.into(), MOST_WORDS))
    }
}

impl From<serde_json::Error> for DecodeError {
    fn from(error: serde_json::Error) -> Self {
        Self::json(plain(&error.to_string()))
    }
}
