//! The seven topics of D6.1 (Table 3) and those of the extensions, under an optional prefix.

/// Topics of the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Topic {
    /// Query of available simulation servers.
    Discovery,
    /// A server's answer to a discovery.
    Server,
    /// Configuration of a simulation.
    Parameters,
    /// Start or end of a run.
    Control,
    /// Sensor readings of one agent.
    Sensor,
    /// Actuator commands of one agent.
    Actuator,
    /// Fitness of a candidate at the end of a run.
    Fitness,
    /// Extension: state of a server, retained.
    Presence,
    /// Extension: requests to one server, in offloaded and batched mode.
    ToServer,
    /// Extension: answers to one tool.
    ToTool,
    /// Extension: activity of one tool, for monitors.
    Status,
}

impl Topic {
    /// The seven topics of D6.1.
    pub const SEED: [Self; 7] = [
        Self::Discovery,
        Self::Server,
        Self::Parameters,
        Self::Control,
        Self::Sensor,
        Self::Actuator,
        Self::Fitness,
    ];

    /// Returns the topic's flat name, without prefix.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Discovery => "discovery",
            Self::Server => "server",
            Self::Parameters => "parameters",
            Self::Control => "control",
            Self::Sensor => "sensor",
            Self::Actuator => "actuator",
            Self::Fitness => "fitness",
            Self::Presence => PRESENCE,
            Self::ToServer => TO_SERVER,
            Self::ToTool => TO_TOOL,
            Self::Status => STATUS,
        }
    }

    fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "discovery" => Self::Discovery,
            "server" => Self::Server,
            "parameters" => Self::Parameters,
            "control" => Self::Control,
            "sensor" => Self::Sensor,
            "actuator" => Self::Actuator,
            "fitness" => Self::Fitness,
            _ => {
                let (root, last) = name.rsplit_once('/')?;
                match root {
                    PRESENCE if last.parse::<u64>().is_ok() => Self::Presence,
                    TO_SERVER if last.parse::<u64>().is_ok() => Self::ToServer,
                    TO_TOOL if !last.is_empty() => Self::ToTool,
                    STATUS if !last.is_empty() => Self::Status,
                    _ => return None,
                }
            }
        })
    }
}

const PRESENCE: &str = "swarmwright/v1/presence";
const TO_SERVER: &str = "swarmwright/v1/server";
const TO_TOOL: &str = "swarmwright/v1/tool";
const STATUS: &str = "swarmwright/v1/status";

/// An invalid topic prefix.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("topic prefix {0:?}: {1}")]
pub struct TopicError(String, &'static str);

/// Topic names with one prefix.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Topics {
    prefix: String,
}

impl Topics {
    /// Creates topic names with a prefix, which is followed by a slash; empty for no prefix.
    ///
    /// # Errors
    /// Fails if the prefix contains wildcards or NUL, starts with a slash or `$`, or has more than 1,000 bytes.
    pub fn new(prefix: &str) -> Result<Self, TopicError> {
        let prefix = prefix.strip_suffix('/').unwrap_or(prefix);
        let wrong = |reason| Err(TopicError(prefix.to_owned(), reason));
        if prefix.contains(['+', '#', '\0']) {
            return wrong("+, # and NUL are reserved in MQTT; use letters, digits, - and /");
        }
        if prefix.starts_with(['/', '$']) {
            return wrong("must not begin with / or $");
        }
        if prefix.len() > 1000 {
            return wrong("is longer than 1,000 bytes");
        }
        Ok(Self {
            prefix: if prefix.is_empty() {
                String::new()
            } else {
                format!("{prefix}/")
            },
        })
    }

    /// Returns the full name of one of the seven topics, or the root of an extension's topics.
    #[must_use]
    pub fn name(&self, topic: Topic) -> String {
        format!("{}{}", self.prefix, topic.name())
    }

    /// Returns the topic of one server's presence.
    #[must_use]
    pub fn presence(&self, server: u64) -> String {
        format!("{}{PRESENCE}/{server}", self.prefix)
    }

    /// Returns the filter for all presence messages.
    #[must_use]
    pub fn presence_filter(&self) -> String {
        format!("{}{PRESENCE}/+", self.prefix)
    }

    /// Returns the topic of requests to one server.
    #[must_use]
    pub fn to_server(&self, server: u64) -> String {
        format!("{}{TO_SERVER}/{server}", self.prefix)
    }

    /// Returns the topic of answers to one tool; `token` identifies the tool, and has letters and digits.
    #[must_use]
    pub fn to_tool(&self, token: &str) -> String {
        format!("{}{TO_TOOL}/{token}", self.prefix)
    }

    /// Returns the topic of one tool's status; `token` as in [`to_tool`](Self::to_tool).
    #[must_use]
    pub fn status(&self, token: &str) -> String {
        format!("{}{STATUS}/{token}", self.prefix)
    }

    /// Returns the filter for all status messages.
    #[must_use]
    pub fn status_filter(&self) -> String {
        format!("{}{STATUS}/+", self.prefix)
    }

    /// Returns the full name of a topic that a message names without prefix.
    #[must_use]
    pub fn under(&self, name: &str) -> String {
        format!("{}{name}", self.prefix)
    }

    /// Returns the topic of a full name; `None` if it is not one of the protocol.
    #[must_use]
    pub fn parse(&self, name: &str) -> Option<Topic> {
        Topic::from_name(name.strip_prefix(self.prefix.as_str())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back_with_and_without_prefix() {
        for prefix in ["", "lab", "lab/", "a/b"] {
            let topics = Topics::new(prefix).unwrap();
            for topic in Topic::SEED {
                assert_eq!(topics.parse(&topics.name(topic)), Some(topic));
            }
            assert_eq!(topics.parse(&topics.presence(7)), Some(Topic::Presence));
        }
        assert_eq!(Topics::new("lab").unwrap().parse("sensor"), None);
        assert_eq!(Topics::default().parse("lab/sensor"), None);
        assert_eq!(Topics::default().parse("swarmwright/v1/presence/x"), None);
    }

    #[test]
    fn prefixes_that_cannot_stand_are_refused() {
        for prefix in ["a/+", "#", "/a", "$SYS", "a\0b"] {
            assert!(Topics::new(prefix).is_err(), "{prefix:?}");
        }
    }
}
