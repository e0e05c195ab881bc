//! Codec of these messages.

use std::fmt;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};

use super::sides::are_valid;
use super::{
    AnnouncedSide, Announcement, Capabilities, Control, Discovery, Message, ParametersMessage,
    Requirements, ServerMessage,
};
use crate::numbers::Id;
use crate::place;
use crate::{
    Actuator, DecodeError, Fitness, MAX_PAYLOAD, Presence, Sensor, Status, ToServer, ToTool, Topic,
    shortened,
};

impl Message {
    /// Decodes the payload of a topic.
    ///
    /// # Errors
    /// Fails if the payload is too large or not a JSON object, if a key is missing, or if a value has the wrong type or
    /// is out of range.
    pub fn decode(topic: Topic, payload: &[u8]) -> Result<Self, DecodeError> {
        Ok(match topic {
            Topic::Discovery => Self::Discovery(Discovery::decode(payload)?),
            Topic::Server => Self::Server(ServerMessage::decode(payload)?),
            Topic::Parameters => Self::Parameters(ParametersMessage::decode(payload)?),
            Topic::Control => Self::Control(Control::decode(payload)?),
            Topic::Sensor => Self::Sensor(Sensor::decode(payload)?),
            Topic::Actuator => Self::Actuator(Actuator::decode(payload)?),
            Topic::Fitness => Self::Fitness(Fitness::decode(payload)?),
            Topic::Presence => Self::Presence(Presence::decode(payload)?),
            Topic::ToServer if is_object(payload) => Self::Control(Control::decode(payload)?),
            Topic::ToServer => Self::ToServer(ToServer::decode(payload)?),
            Topic::ToTool => Self::ToTool(ToTool::decode(payload)?),
            Topic::Status => Self::Status(Box::new(Status::decode(payload)?)),
        })
    }
}

/// Returns whether a payload starts like a JSON object instead of a MessagePack map.
fn is_object(payload: &[u8]) -> bool {
    payload.trim_ascii_start().first() == Some(&b'{')
}

/// Largest number of characters of a value in messages.
const MOST_VALUE: usize = 60;

/// Expected type of a value in an announcement.
enum Expected {
    Whole(u64),
    Names,
    Sides,
    Number,
    Flag,
    Text,
}

impl fmt::Display for Expected {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Whole(least) => write!(formatter, "an integer from {least}"),
            Self::Names => formatter.write_str("a list of names"),
            Self::Sides => formatter.write_str(
                "a list of at most 256 sides, each {name, groups, fitness}, with names of 1 to 100 characters and each group in \
                 one side",
            ),
            Self::Number => formatter.write_str("a number from 0"),
            Self::Flag => formatter.write_str("true or false"),
            Self::Text => formatter.write_str("text"),
        }
    }
}

const TYPES: [(&str, Expected); 17] = [
    ("version", Expected::Whole(1)),
    ("modes", Expected::Names),
    ("controllers", Expected::Names),
    ("distributions", Expected::Names),
    ("metrics", Expected::Names),
    ("sides", Expected::Sides),
    ("batch", Expected::Whole(1)),
    ("lanes", Expected::Whole(1)),
    ("sensors", Expected::Whole(1)),
    ("actuators", Expected::Whole(1)),
    ("determinism", Expected::Text),
    ("tolerance", Expected::Number),
    ("scenes", Expected::Flag),
    ("control", Expected::Flag),
    ("instance", Expected::Text),
    ("host", Expected::Text),
    ("pid", Expected::Whole(0)),
];

/// An object from which keys are removed one by one.
struct Keys {
    object: Map<String, Value>,
    /// Key of the object in the message; empty for the message itself.
    within: &'static str,
}

impl Keys {
    fn read(payload: &[u8]) -> Result<Self, DecodeError> {
        if payload.len() > MAX_PAYLOAD {
            return Err(DecodeError::TooLarge {
                bytes: payload.len(),
                most: MAX_PAYLOAD,
            });
        }
        Ok(Self::of(serde_json::from_slice(payload)?, ""))
    }

    fn of(object: Map<String, Value>, within: &'static str) -> Self {
        Self { object, within }
    }

    fn path(&self, key: &str) -> String {
        match self.within {
            "" => key.to_owned(),
            within => format!("{within}.{key}"),
        }
    }

    fn optional<T: DeserializeOwned>(
        &mut self,
        key: &'static str,
    ) -> Result<Option<T>, DecodeError> {
        let Some(value) = self.object.remove(key) else {
            return Ok(None);
        };
        place::read(value, &self.path(key)).map(Some)
    }

    fn required<T: DeserializeOwned>(&mut self, key: &'static str) -> Result<T, DecodeError> {
        let value = self.optional(key)?;
        value.ok_or_else(|| DecodeError::missing(self.path(key)))
    }

    fn id(&mut self, key: &'static str) -> Result<u64, DecodeError> {
        self.required::<Id>(key).map(|id| id.0)
    }

    /// Reads a key of an extension; a value of another type is ignored, since a peer may use the name for its own
    /// purpose.
    fn lenient<T: DeserializeOwned>(&mut self, key: &'static str) -> Option<T> {
        self.optional(key).ok().flatten()
    }

    /// Reads a count of an extension.
    fn whole(&mut self, key: &'static str) -> Option<usize> {
        let Id(count) = self.lenient(key)?;
        usize::try_from(count).ok()
    }

    /// Reads `max_agents`, also in the spelling of the published server schema.
    fn max_agents(&mut self) -> Result<Option<f64>, DecodeError> {
        let published = self.optional("max agents")?;
        Ok(self.optional("max_agents")?.or(published))
    }
}

fn bytes(object: &Value) -> Vec<u8> {
    object.to_string().into_bytes()
}

fn insert(object: &mut Value, key: &str, value: Option<impl Into<Value>>) {
    if let (Some(object), Some(value)) = (object.as_object_mut(), value) {
        object.insert(key.to_owned(), value.into());
    }
}

impl Requirements {
    /// Reads an object such as `{"dimensions": 2}`.
    ///
    /// # Errors
    /// Fails if `dimensions` is missing, or if a value is not a number.
    pub fn from_object(object: Map<String, Value>) -> Result<Self, DecodeError> {
        Self::read(Keys::of(object, ""))
    }

    fn read(mut keys: Keys) -> Result<Self, DecodeError> {
        Ok(Self {
            dimensions: keys.required("dimensions")?,
            max_agents: keys.max_agents()?,
        })
    }

    fn to_value(&self) -> Value {
        let mut object = json!({"dimensions": number(self.dimensions)});
        insert(&mut object, "max_agents", self.max_agents.map(number));
        object
    }

    /// Reads a JSON object such as `{"dimensions": 2}`.
    ///
    /// # Errors
    /// Fails if the payload is not a JSON object, if `dimensions` is missing, or if a value is not a number.
    pub fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        Self::read(Keys::read(payload)?)
    }
}

/// Writes integers without a trailing `.0`, as the published examples do; -0.0 is not an integer.
fn number(value: f64) -> Value {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "only integers that binary64 holds exactly"
    )]
    if value.fract() == 0.0 && value.abs() < 9e15 && (value != 0.0 || value.is_sign_positive()) {
        Value::from(value as i64)
    } else {
        Value::from(value)
    }
}

impl Discovery {
    fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        let mut keys = Keys::read(payload)?;
        Ok(Self {
            simulation: keys.required("simulation")?,
            simulation_hash: keys.required("simulation_hash")?,
            requirements: Requirements::read(Keys::of(
                keys.required("requirements")?,
                "requirements",
            ))?,
            tool: keys.lenient("tool"),
        })
    }

    /// Encodes the payload.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut object = json!({
            "simulation": self.simulation,
            "simulation_hash": self.simulation_hash,
            "requirements": self.requirements.to_value(),
        });
        insert(&mut object, "tool", self.tool.clone());
        bytes(&object)
    }
}

impl Capabilities {
    /// Returns whether a server with these capabilities meets the requirements: the same number of dimensions, and
    /// enough agents.
    #[must_use]
    #[expect(clippy::float_cmp, reason = "numbers of dimensions are small integers")]
    pub fn fulfil(&self, requirements: &Requirements) -> bool {
        let enough = match (self.max_agents, requirements.max_agents) {
            (Some(offered), Some(required)) => offered >= required,
            _ => true,
        };
        self.dimensions == requirements.dimensions && enough
    }

    pub(crate) fn from_object(object: Map<String, Value>) -> Result<Self, DecodeError> {
        let mut keys = Keys::of(object, "capabilities");
        Ok(Self {
            dimensions: keys.required("dimensions")?,
            max_agents: keys.max_agents()?,
            swarmwright: keys
                .lenient("swarmwright")
                .and_then(Announcement::from_object),
        })
    }

    /// Returns the JSON object for messages.
    #[must_use]
    pub fn to_value(&self) -> Value {
        let mut object = json!({"dimensions": number(self.dimensions)});
        insert(&mut object, "max_agents", self.max_agents.map(number));
        insert(
            &mut object,
            "swarmwright",
            self.swarmwright.as_ref().map(Announcement::to_value),
        );
        object
    }
}

impl Announcement {
    fn from_object(object: Map<String, Value>) -> Option<Self> {
        let mut keys = Keys::of(object, "capabilities.swarmwright");
        Some(Self {
            version: keys.id("version").ok()?,
            modes: keys.lenient("modes").unwrap_or_default(),
            controllers: keys.lenient("controllers").unwrap_or_default(),
            batch: keys.whole("batch").filter(|most| *most > 0),
            lanes: keys.whole("lanes").filter(|lanes| *lanes > 0),
            modules: keys.lenient("modules").unwrap_or_default(),
            distributions: keys.lenient("distributions").unwrap_or_default(),
            sensors: keys.whole("sensors"),
            actuators: keys.whole("actuators"),
            metrics: keys.lenient("metrics").unwrap_or_default(),
            sides: keys
                .lenient("sides")
                .filter(|sides: &Vec<AnnouncedSide>| are_valid(sides))
                .unwrap_or_default(),
            determinism: keys.lenient("determinism"),
            tolerance: keys
                .lenient("tolerance")
                .filter(|tolerance| *tolerance >= 0.0),
            scenes: keys.lenient("scenes").unwrap_or_default(),
            control: keys.lenient("control").unwrap_or_default(),
            instance: keys.lenient("instance"),
            host: keys.lenient("host"),
            pid: keys.lenient("pid").map(|Id(pid)| pid),
        })
    }

    /// Describes the values of an announcement that have the wrong type and are ignored. `payload` is that of a server
    /// or presence message.
    #[must_use]
    pub fn mistakes(payload: &[u8]) -> Vec<String> {
        #[derive(Deserialize)]
        struct Outer {
            capabilities: Inner,
        }
        #[derive(Deserialize)]
        struct Inner {
            swarmwright: Map<String, Value>,
        }
        let Ok(outer) = serde_json::from_slice::<Outer>(payload) else {
            return Vec::new();
        };
        let announced = outer.capabilities.swarmwright;
        let wrong = |value: &Value, expected: &Expected| match expected {
            Expected::Whole(least) => {
                !serde_json::from_value::<Id>(value.clone()).is_ok_and(|Id(id)| id >= *least)
            }
            Expected::Names => !value
                .as_array()
                .is_some_and(|list| list.iter().all(Value::is_string)),
            Expected::Sides => {
                !Vec::deserialize(value).is_ok_and(|sides: Vec<AnnouncedSide>| are_valid(&sides))
            }
            Expected::Number => !value.as_f64().is_some_and(|number| number >= 0.0),
            Expected::Flag => !value.is_boolean(),
            Expected::Text => !value.is_string(),
        };
        let mistake_of = |(key, expected): &(&str, Expected)| {
            let value = announced.get(*key)?;
            wrong(value, expected).then(|| {
                let text = shortened(value.to_string(), MOST_VALUE);
                let note = if value.is_string() { " (a string)" } else { "" };
                format!("\"{key}\" is {text}{note}, expected {expected}")
            })
        };
        TYPES.iter().filter_map(mistake_of).collect()
    }

    fn to_value(&self) -> Value {
        let mut object = json!({"version": self.version, "modes": self.modes});
        let controllers = Some(self.controllers.clone()).filter(|kinds| !kinds.is_empty());
        insert(&mut object, "controllers", controllers);
        insert(&mut object, "batch", self.batch);
        insert(&mut object, "lanes", self.lanes);
        let modules = (!self.modules.is_empty()).then(|| json!(self.modules));
        insert(&mut object, "modules", modules);
        let distributions = Some(self.distributions.clone()).filter(|names| !names.is_empty());
        insert(&mut object, "distributions", distributions);
        insert(&mut object, "sensors", self.sensors);
        insert(&mut object, "actuators", self.actuators);
        let metrics = Some(self.metrics.clone()).filter(|names| !names.is_empty());
        insert(&mut object, "metrics", metrics);
        let sides = (!self.sides.is_empty()).then(|| json!(self.sides));
        insert(&mut object, "sides", sides);
        insert(&mut object, "determinism", self.determinism.clone());
        insert(&mut object, "tolerance", self.tolerance);
        insert(&mut object, "scenes", self.scenes.then_some(true));
        insert(&mut object, "control", self.control.then_some(true));
        insert(&mut object, "instance", self.instance.clone());
        insert(&mut object, "host", self.host.clone());
        insert(&mut object, "pid", self.pid);
        object
    }
}

impl ServerMessage {
    fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        let mut keys = Keys::read(payload)?;
        let simulations: Vec<String> = keys.required("simulations")?;
        if simulations.is_empty() {
            return Err(DecodeError::value("\"simulations\" is empty".to_owned()));
        }
        Ok(Self {
            server: keys.id("server")?,
            simulation_hash: keys.required("simulation_hash")?,
            simulations,
            capabilities: Capabilities::from_object(keys.required("capabilities")?)?,
        })
    }

    /// Encodes the payload.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        bytes(&json!({
            "server": self.server,
            "simulation_hash": self.simulation_hash,
            "simulations": self.simulations,
            "capabilities": self.capabilities.to_value(),
        }))
    }
}

impl ParametersMessage {
    fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        let mut keys = Keys::read(payload)?;
        Ok(Self {
            server: keys.id("server")?,
            simulation_hash: keys.required("simulation_hash")?,
            parameters: keys.object,
        })
    }

    /// Encodes the payload; the parameters are at the same level as the two keys of the protocol.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut object = self.parameters.clone();
        object.insert("server".to_owned(), self.server.into());
        object.insert(
            "simulation_hash".to_owned(),
            self.simulation_hash.clone().into(),
        );
        bytes(&Value::Object(object))
    }
}

impl Control {
    fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        let mut keys = Keys::read(payload)?;
        Ok(Self {
            server: keys.id("server")?,
            simulation: keys.optional("simulation")?,
            simulation_hash: keys.required("simulation_hash")?,
            run: keys.optional("run")?.unwrap_or(true),
            visual: keys.optional("visual")?.unwrap_or(false),
            tool: keys.lenient("tool"),
            reply: keys.lenient("reply"),
            instance: keys.lenient("instance"),
            scenes: keys.lenient("scenes"),
        })
    }

    /// Encodes the payload.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut object = json!({
            "server": self.server,
            "simulation_hash": self.simulation_hash,
            "run": self.run,
            "visual": self.visual,
        });
        insert(&mut object, "simulation", self.simulation.clone());
        insert(&mut object, "tool", self.tool.clone());
        insert(&mut object, "reply", self.reply.clone());
        insert(&mut object, "instance", self.instance.clone());
        insert(&mut object, "scenes", self.scenes.clone());
        bytes(&object)
    }
}
