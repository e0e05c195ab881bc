//! Messages of the steps and the end of a run: sensor, actuator, fitness.
//!
//! A run sends millions of them, so they are decoded without an intermediate tree. The last of repeated keys wins;
//! unknown keys are ignored.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;
use serde::de::{Deserialize, Deserializer, Error, MapAccess, Visitor};
use serde_json::value::RawValue;
use serde_json::{Map, Value};
use swarmwright_values::plain;

use crate::numbers::{Id, Real32, Real64};
use crate::place::{self, at};
use crate::{DecodeError, MAX_PAYLOAD, MAX_SENSOR};

/// Largest nesting depth of a message, including its own object; the same as the limit of `serde_json` for a tree.
const MAX_NESTING: usize = 127;

/// Sensor readings of one agent (D6.1, Schema 5).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sensor {
    /// Title of the simulation; required by the published schema, but omitted in its examples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulation: Option<String>,
    /// Hash that identifies the episode.
    pub simulation_hash: String,
    /// Index of the agent.
    pub agent: u64,
    /// Readings, at least one.
    pub sensor: Vec<f32>,
}

/// Actuator commands of one agent (D6.1, Schema 6).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Actuator {
    /// Title of the simulation; required by the published schema, but omitted in its examples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulation: Option<String>,
    /// Hash that identifies the episode.
    pub simulation_hash: String,
    /// Index of the agent.
    pub agent: u64,
    /// Commands, at least one; the server clamps them to -1..=1.
    pub actuator: Vec<f32>,
}

/// Fitness at the end of a run (D6.1, Schema 7).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fitness {
    /// Title of the simulation; required by the published schema, but omitted in its examples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulation: Option<String>,
    /// Hash that identifies the episode.
    pub simulation_hash: String,
    /// Fitness of any sign and size; larger is better.
    pub fitness: f64,
    /// Extension: other measurements of the episode, by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, f64>,
}

/// All keys of the three messages; the topic determines which of them are read.
#[derive(Default)]
struct Fields<'a> {
    simulation: Option<Cow<'a, str>>,
    simulation_hash: Option<Cow<'a, str>>,
    agent: Option<u64>,
    sensor: Option<Vec<f32>>,
    actuator: Option<Vec<f32>>,
    fitness: Option<f64>,
    metrics: Option<&'a RawValue>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Sensor,
    Actuator,
    Fitness,
}

/// A known key, read without copying it.
enum Key {
    Simulation,
    Hash,
    Agent,
    Sensor,
    Actuator,
    Fitness,
    Metrics,
    Other,
}

impl<'de> Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct KeyVisitor;
        impl Visitor<'_> for KeyVisitor {
            type Value = Key;
            fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
                formatter.write_str("a key")
            }
            fn visit_str<E>(self, key: &str) -> Result<Key, E> {
                Ok(match key {
                    "simulation" => Key::Simulation,
                    "simulation_hash" => Key::Hash,
                    "agent" => Key::Agent,
                    "sensor" => Key::Sensor,
                    "actuator" => Key::Actuator,
                    "fitness" => Key::Fitness,
                    "metrics" => Key::Metrics,
                    _ => Key::Other,
                })
            }
        }
        deserializer.deserialize_identifier(KeyVisitor)
    }
}

/// A string, copied only if it contains escapes.
struct Text<'a>(Cow<'a, str>);

impl<'de> Deserialize<'de> for Text<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct TextVisitor;
        impl<'de> Visitor<'de> for TextVisitor {
            type Value = Text<'de>;
            fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
                formatter.write_str("a string")
            }
            fn visit_borrowed_str<E>(self, text: &'de str) -> Result<Text<'de>, E> {
                Ok(Text(Cow::Borrowed(text)))
            }
            fn visit_str<E>(self, text: &str) -> Result<Text<'de>, E> {
                Ok(Text(Cow::Owned(text.to_owned())))
            }
        }
        deserializer.deserialize_str(TextVisitor)
    }
}

fn read(payload: &[u8], kind: Kind) -> Result<Fields<'_>, DecodeError> {
    struct FieldsVisitor(Kind);
    impl<'de> Visitor<'de> for FieldsVisitor {
        type Value = Fields<'de>;
        fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
            formatter.write_str("an object")
        }
        fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Fields<'de>, A::Error> {
            let mut fields = Fields::default();
            let vector = |values: Vec<Real32>| values.into_iter().map(|value| value.0).collect();
            while let Some(key) = map.next_key()? {
                match key {
                    Key::Simulation => fields.simulation = Some(map.next_value::<Text>()?.0),
                    Key::Hash => fields.simulation_hash = Some(map.next_value::<Text>()?.0),
                    Key::Agent if self.0 != Kind::Fitness => {
                        fields.agent = Some(map.next_value::<Id>()?.0)
                    }
                    Key::Sensor if self.0 == Kind::Sensor => {
                        fields.sensor = Some(vector(map.next_value()?))
                    }
                    Key::Actuator if self.0 == Kind::Actuator => {
                        fields.actuator = Some(vector(map.next_value()?))
                    }
                    Key::Fitness if self.0 == Kind::Fitness => {
                        fields.fitness = Some(map.next_value::<Real64>()?.0)
                    }
                    Key::Metrics if self.0 == Kind::Fitness => {
                        fields.metrics = Some(sound(map.next_value()?)?);
                    }
                    _ => {
                        sound::<A::Error>(map.next_value()?)?;
                    }
                }
            }
            Ok(fields)
        }
    }
    let most = match kind {
        Kind::Sensor => MAX_SENSOR,
        Kind::Actuator | Kind::Fitness => MAX_PAYLOAD,
    };
    let bytes = payload.len();
    if bytes > most {
        return Err(DecodeError::TooLarge { bytes, most });
    }
    let mut deserializer = serde_json::Deserializer::from_slice(payload);
    match deserializer.deserialize_map(FieldsVisitor(kind)) {
        Ok(fields) => {
            deserializer.end()?;
            Ok(fields)
        }
        Err(error) => {
            // Decode again to locate the error; tracking the path in every message would be slow.
            let mut deserializer = serde_json::Deserializer::from_slice(payload);
            let mut track = serde_path_to_error::Track::new();
            let tracked = serde_path_to_error::Deserializer::new(&mut deserializer, &mut track);
            let _ = tracked.deserialize_map(FieldsVisitor(kind));
            let path = track.path().to_string();
            Err(DecodeError::json(at(&path, &plain(&error.to_string()))))
        }
    }
}

/// Checks the nesting depth of a raw value, which has not been parsed but is valid UTF-8.
fn sound<E: Error>(value: &RawValue) -> Result<&RawValue, E> {
    let (mut depth, mut text, mut escaped) = (1, false, false);
    for byte in value.get().bytes() {
        match byte {
            _ if escaped => escaped = false,
            b'\\' => escaped = text,
            b'"' => text = !text,
            b'[' | b'{' if !text => {
                depth += 1;
                if depth > MAX_NESTING {
                    return Err(E::custom(format_args!(
                        "more than {MAX_NESTING} levels of nesting"
                    )));
                }
            }
            b']' | b'}' if !text => depth -= 1,
            _ => {}
        }
    }
    Ok(value)
}

/// Reads the metrics of the extension; other values are ignored, since a peer may use the name for its own purpose.
fn metrics(value: Option<&RawValue>) -> BTreeMap<String, f64> {
    let read = |value: &RawValue| serde_json::from_str::<Real64>(value.get()).ok();
    let object = value
        .and_then(|value| serde_json::from_str::<BTreeMap<String, &RawValue>>(value.get()).ok());
    let entries = object.into_iter().flatten();
    entries
        .filter_map(|(name, value)| Some((name, read(value)?.0)))
        .collect()
}

fn filled(values: Option<Vec<f32>>, key: &'static str) -> Result<Vec<f32>, DecodeError> {
    let values = values.ok_or_else(|| DecodeError::missing(key))?;
    if values.is_empty() {
        Err(DecodeError::value(format!("\"{key}\" is empty")))
    } else {
        Ok(values)
    }
}

fn write<T: Serialize>(message: &T) -> Vec<u8> {
    // Strings, integers and numbers cannot fail to serialize; a number that is not finite becomes null, which no peer
    // accepts.
    serde_json::to_vec(message).unwrap_or_default()
}

/// Writer of one episode's sensor or actuator messages. The result is byte for byte that of `Sensor::encode` or
/// `Actuator::encode`, but the constant part is encoded only once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReadingWriter {
    /// Everything before the agent.
    head: Vec<u8>,
    /// Everything between the agent and the numbers.
    middle: &'static [u8],
}

impl ReadingWriter {
    /// Creates a writer of sensor messages. `simulation` is the title, `hash` identifies the episode.
    #[must_use]
    pub fn sensor(simulation: &str, hash: &str) -> Self {
        Self::new(simulation, hash, b",\"sensor\":[")
    }

    /// Creates a writer of actuator messages. `simulation` is the title, `hash` identifies the episode.
    #[must_use]
    pub fn actuator(simulation: &str, hash: &str) -> Self {
        Self::new(simulation, hash, b",\"actuator\":[")
    }

    fn new(simulation: &str, hash: &str, middle: &'static [u8]) -> Self {
        let mut head = b"{\"simulation\":".to_vec();
        head.append(&mut write(&simulation));
        head.extend_from_slice(b",\"simulation_hash\":");
        head.append(&mut write(&hash));
        head.extend_from_slice(b",\"agent\":");
        Self { head, middle }
    }

    /// Encodes the payload for one agent. Numbers are the shortest decimals that are parsed as the same binary32.
    #[must_use]
    pub fn encode(&self, agent: u64, numbers: &[f32]) -> Vec<u8> {
        // The longest binary32 has 16 characters, but most have at most 12.
        let capacity = self.head.len() + self.middle.len() + 22 + 13 * numbers.len();
        let mut payload = Vec::with_capacity(capacity);
        payload.extend_from_slice(&self.head);
        append(&mut payload, &agent);
        payload.extend_from_slice(self.middle);
        for (index, number) in numbers.iter().enumerate() {
            if index > 0 {
                payload.push(b',');
            }
            append(&mut payload, number);
        }
        payload.extend_from_slice(b"]}");
        payload
    }
}

fn append<T: Serialize>(payload: &mut Vec<u8>, value: &T) {
    // Neither writing to a Vec nor serializing a number can fail.
    let _ = serde_json::to_writer(payload, value);
}

/// A sensor message whose strings are borrowed, for optimization tools.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorReading<'a> {
    /// Title of the simulation, if the server sends it.
    pub simulation: Option<Cow<'a, str>>,
    /// Hash that identifies the episode.
    pub simulation_hash: Cow<'a, str>,
    /// Index of the agent.
    pub agent: u64,
    /// Readings, at least one.
    pub sensor: Vec<f32>,
}

impl<'a> SensorReading<'a> {
    /// Decodes a payload.
    ///
    /// # Errors
    /// See `Sensor::decode`.
    pub fn decode(payload: &'a [u8]) -> Result<Self, DecodeError> {
        let fields = read(payload, Kind::Sensor)?;
        Ok(Self {
            simulation: fields.simulation,
            simulation_hash: fields
                .simulation_hash
                .ok_or_else(|| DecodeError::missing("simulation_hash"))?,
            agent: fields.agent.ok_or_else(|| DecodeError::missing("agent"))?,
            sensor: filled(fields.sensor, "sensor")?,
        })
    }
}

impl Sensor {
    /// Decodes a payload.
    ///
    /// # Errors
    /// Fails if the payload is too large or not a JSON object, if a required key is missing, if a value has the wrong
    /// type, or if there are no readings or values that are not finite.
    pub fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        let fields = read(payload, Kind::Sensor)?;
        Ok(Self {
            simulation: fields.simulation.map(Cow::into_owned),
            simulation_hash: fields
                .simulation_hash
                .ok_or_else(|| DecodeError::missing("simulation_hash"))?
                .into_owned(),
            agent: fields.agent.ok_or_else(|| DecodeError::missing("agent"))?,
            sensor: filled(fields.sensor, "sensor")?,
        })
    }

    /// Encodes the payload. Numbers are the shortest decimals that are parsed as the same binary32.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        write(self)
    }
}

impl Actuator {
    /// Decodes a payload.
    ///
    /// # Errors
    /// Fails if the payload is too large or not a JSON object, if a required key is missing, if a value has the wrong
    /// type, or if there are no commands or values that are not finite.
    pub fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        let fields = read(payload, Kind::Actuator)?;
        Ok(Self {
            simulation: fields.simulation.map(Cow::into_owned),
            simulation_hash: fields
                .simulation_hash
                .ok_or_else(|| DecodeError::missing("simulation_hash"))?
                .into_owned(),
            agent: fields.agent.ok_or_else(|| DecodeError::missing("agent"))?,
            actuator: filled(fields.actuator, "actuator")?,
        })
    }

    /// Encodes the payload. Numbers are the shortest decimals that are parsed as the same binary32.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        write(self)
    }
}

impl Fitness {
    /// Decodes a payload.
    ///
    /// # Errors
    /// Fails if the payload is too large or not a JSON object, if a required key is missing, if a value has the wrong
    /// type, or if the fitness is not finite.
    pub fn decode(payload: &[u8]) -> Result<Self, DecodeError> {
        let fields = read(payload, Kind::Fitness)?;
        Ok(Self {
            simulation: fields.simulation.map(Cow::into_owned),
            simulation_hash: fields
                .simulation_hash
                .ok_or_else(|| DecodeError::missing("simulation_hash"))?
                .into_owned(),
            fitness: fields
                .fitness
                .ok_or_else(|| DecodeError::missing("fitness"))?,
            metrics: metrics(fields.metrics),
        })
    }

    /// Describes the problem with a metric in a payload; `None` if it is a finite number, null or missing.
    #[must_use]
    pub fn wrong_metric(payload: &[u8], name: &str) -> Option<String> {
        let fields = read(payload, Kind::Fitness).ok()?;
        let value: Value = serde_json::from_str(fields.metrics?.get()).ok()?;
        let wrong = match place::read::<Map<String, Value>>(value, "metrics") {
            Ok(mut metrics) => {
                let path = format!("metrics.{name}");
                let value = metrics.remove(name).filter(|value| !value.is_null())?;
                place::read::<Real64>(value, &path).err()?
            }
            Err(error) => error,
        };
        Some(wrong.to_string())
    }

    /// Encodes the payload. The fitness is the shortest decimal that is parsed as the same binary64.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        write(self)
    }
}

#[cfg(test)]
mod tests;
