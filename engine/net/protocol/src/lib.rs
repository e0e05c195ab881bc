//! Typed messages to bytes and back, topics, hashes, validation.
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
    Announcement, Capabilities, Control, Discovery, Message, ModuleCode, ParametersMessage,
    Requirements, SCENE_PARTS, ServerMessage, missing_module,
};
pub use presence::{Presence, State};
pub use readings::{Actuator, Fitness, ReadingWriter, Sensor, SensorReading};
pub use status::{Activity, MOST_LISTED, Missing, NoServer, PieceKind, Status, Used, Waiting};
pub use topics::{Topic, TopicError, Topics};
pub use values::bytes_of;

/// Larger payloads are refused unread, but for sensor messages.
pub const MAX_PAYLOAD: usize = 1 << 20;

/// Larger sensor messages are refused unread: what an agent sees may be a picture, or a map.
pub const MAX_SENSOR: usize = MAX_BLOCK;

/// Why a payload is not a message of its topic.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// Larger than [`MAX_PAYLOAD`], or [`MAX_SENSOR`].
    #[error("{bytes} bytes are more than the {most} that a message may have")]
    TooLarge {
        /// Its bytes.
        bytes: usize,
        /// How many it may have.
        most: usize,
    },
    /// No JSON, or JSON of another shape; where and what was expected.
    #[error("{0}")]
    Json(String),
    /// A key that has to be there is not.
    #[error("the required key \"{0}\" is missing")]
    Missing(Cow<'static, str>),
    /// A value of the wrong type, or one that cannot be; where and what was expected.
    #[error("{0}")]
    Value(String),
}

/// Characters of what is said about a payload, at most: some of it is quoted, and a peer may send a mebibyte in the place
/// of a number.
const MOST_WORDS: usize = 400;

impl DecodeError {
    /// A key that has to be there is not; its path.
    pub(crate) fn missing(path: impl Into<Cow<'static, str>>) -> Self {
        Self::Missing(path.into())
    }

    /// JSON of another shape; where and what was expected.
    pub(crate) fn json(words: impl Into<String>) -> Self {
        Self::Json(shortened(words.into(), MOST_WORDS))
    }

    /// The key with which something is wrong, without the indices of lists; empty for the message as a whole.
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

    /// A value that cannot be; what is wrong with it.
    pub(crate) fn value(words: impl Into<String>) -> Self {
        Self::Value(shortened(words.into(), MOST_WORDS))
    }
}

impl From<serde_json::Error> for DecodeError {
    fn from(error: serde_json::Error) -> Self {
        Self::json(plain(&error.to_string()))
    }
}
