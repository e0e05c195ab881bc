//! Scenes of a simulation, for tools that show episodes of simulations that they do not have.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{F32s, U32s};
use crate::DecodeError;

/// Value in [`Bodies::agent`] for a body that is not an agent.
pub const NO_AGENT: u32 = u32::MAX;

/// Shapes that a style may have; empty for the default.
const SHAPES: [&str; 9] = [
    "", "circle", "cross", "triangle", "star", "square", "diamond", "pentagon", "hexagon",
];
/// Largest number of pairs of kind and state; more are an error of the server.
const MOST_LOOKS: usize = 1000;

/// Server to tool: the scene of an episode before its first step, and after each step.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SceneMessage {
    /// [`EXTENSION_VERSION`](super::EXTENSION_VERSION).
    pub version: u64,
    /// Id of the server.
    pub server: u64,
    /// Hash of the control message that started the episode.
    pub simulation_hash: String,
    /// Number of completed steps.
    pub step: u64,
    /// Fitness so far.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitness: Option<f64>,
    /// Metrics so far.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, f64>,
    /// Seconds for which to show the scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Extent in x, in metres or cells.
    pub width: f32,
    /// Extent in y, in metres or cells.
    pub height: f32,
    /// Position of (0, 0) in the simulation's own coordinates; (0, 0) by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<[f32; 2]>,
    /// Whether the unit is a cell instead of a metre.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub grid: bool,
    /// A line of text shown above the scene.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub message: String,
    /// Bodies, from bottom to top.
    pub bodies: Bodies,
    /// Rays of the bodies' sensors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rays: Option<Rays>,
    /// Pairs of indices of bodies; the second body hears the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub links: Option<U32s>,
    /// The floor; without points if it fills the world.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<ScenePatch>,
    /// Areas of the floor.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub patches: Vec<ScenePatch>,
    /// Immovable obstacles.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub walls: Vec<SceneWall>,
    /// Lamps.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<SceneLight>,
    /// Appearance of kinds and states.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub styles: Vec<SceneStyle>,
    /// Name and range of the bodies' values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<SceneScale>,
}

/// Bodies as arrays, with one element per body.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Bodies {
    /// Pairs of kind and state.
    pub looks: Vec<[String; 2]>,
    /// Index of each body's pair; all bodies have the first pair if omitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub look: Option<U32s>,
    /// Positions in x.
    pub x: F32s,
    /// Positions in y, upwards.
    pub y: F32s,
    /// Radius of each body, or a single one for all; bodies are points if omitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius: Option<F32s>,
    /// Headings in radians, counter-clockwise from the x axis; NaN for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading: Option<F32s>,
    /// Values that determine colours; NaN for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<F32s>,
    /// Agent of each body; [`NO_AGENT`] for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent: Option<U32s>,
    /// Short labels.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub labels: Vec<String>,
}

/// Rays of sensors as arrays, with one element per ray.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Rays {
    /// Index of the body.
    pub body: U32s,
    /// Angle from the heading in radians, counter-clockwise.
    pub angle: F32s,
    /// Distance of the start from the centre of the body.
    pub start: F32s,
    /// Length from the start.
    pub length: F32s,
    /// Reading of the sensor, from 0 to 1; NaN for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reading: Option<F32s>,
}

/// An area of the floor: a polygon, or a circle around a single point.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ScenePatch {
    /// Grey level, from 0 (black) to 1 (white).
    pub grey: f32,
    /// Corners in order, or the centre of a circle.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<[f32; 2]>,
    /// Radius of a circle.
    #[serde(default)]
    pub radius: f32,
    /// Name in legends.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
}

/// A polyline, or a solid polygon.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SceneWall {
    /// At least two points.
    pub points: Vec<[f32; 2]>,
    /// Whether the points are the corners of a filled polygon.
    #[serde(default)]
    pub solid: bool,
}

/// A lamp.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SceneLight {
    /// Position in x.
    pub x: f32,
    /// Position in y.
    pub y: f32,
    /// Intensity; 0 if the lamp is off.
    #[serde(default = "one")]
    pub intensity: f32,
}

fn one() -> f32 {
    1.0
}

/// Appearance of bodies with a kind and a state.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SceneStyle {
    /// Kind of the bodies.
    pub kind: String,
    /// State of the bodies; empty for all states without their own style.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub state: String,
    /// `#rrggbb`; empty for the default.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub color: String,
    /// circle, cross, triangle, star, square, diamond, pentagon or hexagon; empty for the default.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub shape: String,
}

/// Name and range of the bodies' values.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SceneScale {
    /// Name, including the unit.
    pub name: String,
    /// Value shown in the first colour.
    pub low: f32,
    /// Value shown in the last colour.
    pub high: f32,
}

impl SceneMessage {
    /// Returns the approximate size of the arrays in bytes.
    pub(super) fn numbers(&self) -> usize {
        let rays = self.rays.as_ref().map_or(0, |rays| rays.body.0.len());
        let links = self.links.as_ref().map_or(0, |links| links.0.len());
        28 * self.bodies.x.0.len() + 20 * rays + 4 * links
    }

    /// Checks what the types do not guarantee: matching arrays, valid indices, and finite numbers.
    pub(super) fn check(&self) -> Result<(), DecodeError> {
        let sizes = [("width", self.width), ("height", self.height)];
        for (name, size) in sizes {
            if !(size.is_finite() && size > 0.0) {
                return wrong(format!("\"{name}\" is {size}, expected a number above 0"));
            }
        }
        if let Some(origin) = &self.origin {
            finite("origin", origin)?;
        }
        if self
            .seconds
            .is_some_and(|seconds| seconds.is_nan() || seconds < 0.0)
        {
            return wrong("\"seconds\" is not a number of seconds".to_owned());
        }
        self.bodies.check()?;
        let bodies = self.bodies.x.0.len();
        if let Some(rays) = &self.rays {
            rays.check(bodies)?;
        }
        if let Some(links) = &self.links {
            if links.0.len() % 2 == 1 {
                return wrong("\"links\" are not pairs".to_owned());
            }
            indices("links", &links.0, bodies, "bodies")?;
        }
        self.check_world()
    }

    fn check_world(&self) -> Result<(), DecodeError> {
        for patch in self.patches.iter().chain(&self.floor) {
            points("patches", &patch.points)?;
            if !(0.0..=1.0).contains(&patch.grey) || !(0.0..=f32::MAX).contains(&patch.radius) {
                return wrong(
                    "a patch's \"grey\" is not in 0..1, or its \"radius\" below 0".to_owned(),
                );
            }
        }
        for wall in &self.walls {
            points("walls", &wall.points)?;
        }
        for style in &self.styles {
            let digits = style.color.strip_prefix('#').unwrap_or_default();
            let hexadecimal =
                digits.len() == 6 && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
            if !(style.color.is_empty() || hexadecimal) {
                return wrong(format!(
                    "a style's \"color\" is {:?}, expected #rrggbb",
                    style.color
                ));
            }
            if !SHAPES.contains(&&*style.shape) {
                return wrong(format!(
                    "a style's \"shape\" is {:?}, expected {}",
                    style.shape,
                    SHAPES[1..].join(", ")
                ));
            }
        }
        let lights = self.lights.iter().flat_map(|l| [l.x, l.y, l.intensity]);
        let scale = self.scale.iter().flat_map(|scale| [scale.low, scale.high]);
        if lights.chain(scale).any(|number| !number.is_finite()) {
            return wrong("a number of \"lights\" or \"scale\" is NaN or infinite".to_owned());
        }
        Ok(())
    }
}

impl Bodies {
    fn check(&self) -> Result<(), DecodeError> {
        let count = self.x.0.len();
        same("bodies.y", self.y.0.len(), count)?;
        finite("bodies.x", &self.x.0)?;
        finite("bodies.y", &self.y.0)?;
        if let Some(radius) = &self.radius {
            if radius.0.len() != 1 {
                same("bodies.radius", radius.0.len(), count)?;
            }
            finite("bodies.radius", &radius.0)?;
            if radius.0.iter().any(|radius| *radius < 0.0) {
                return wrong("a \"bodies.radius\" is below 0".to_owned());
            }
        }
        for (name, numbers) in [
            ("bodies.heading", &self.heading),
            ("bodies.value", &self.value),
        ] {
            if let Some(numbers) = numbers {
                same(name, numbers.0.len(), count)?;
                if numbers.0.iter().any(|number| number.is_infinite()) {
                    return wrong(format!("a number of \"{name}\" is infinite"));
                }
            }
        }
        if let Some(agent) = &self.agent {
            same("bodies.agent", agent.0.len(), count)?;
        }
        if !self.labels.is_empty() {
            same("bodies.labels", self.labels.len(), count)?;
        }
        if self.looks.len() > MOST_LOOKS {
            return wrong(format!(
                "\"bodies.looks\" has {} entries, more than {MOST_LOOKS}",
                self.looks.len()
            ));
        }
        match &self.look {
            Some(look) => {
                same("bodies.look", look.0.len(), count)?;
                indices("bodies.look", &look.0, self.looks.len(), "looks")
            }
            None if count > 0 && self.looks.is_empty() => {
                wrong("\"bodies.looks\" is empty, but there are bodies".to_owned())
            }
            None => Ok(()),
        }
    }
}

impl Rays {
    fn check(&self, bodies: usize) -> Result<(), DecodeError> {
        let count = self.body.0.len();
        indices("rays.body", &self.body.0, bodies, "bodies")?;
        for (name, numbers) in [
            ("rays.angle", &self.angle),
            ("rays.start", &self.start),
            ("rays.length", &self.length),
        ] {
            same(name, numbers.0.len(), count)?;
            finite(name, &numbers.0)?;
        }
        match &self.reading {
            Some(reading) => same("rays.reading", reading.0.len(), count),
            None => Ok(()),
        }
    }
}

fn wrong<T>(words: String) -> Result<T, DecodeError> {
    Err(DecodeError::value(words))
}

fn same(name: &str, count: usize, expected: usize) -> Result<(), DecodeError> {
    if count == expected {
        return Ok(());
    }
    wrong(format!(
        "\"{name}\" has {count} entries, expected {expected}"
    ))
}

fn finite(name: &str, numbers: &[f32]) -> Result<(), DecodeError> {
    match numbers.iter().position(|number| !number.is_finite()) {
        Some(index) => wrong(format!("\"{name}\"[{index}] is NaN or infinite")),
        None => Ok(()),
    }
}

fn indices(name: &str, numbers: &[u32], below: usize, of: &str) -> Result<(), DecodeError> {
    match numbers.iter().find(|index| **index as usize >= below) {
        Some(index) => wrong(format!(
            "\"{name}\": there is no {index} among {below} {of}"
        )),
        None => Ok(()),
    }
}

fn points(name: &str, points: &[[f32; 2]]) -> Result<(), DecodeError> {
    if points.iter().flatten().all(|number| number.is_finite()) {
        return Ok(());
    }
    wrong(format!("a point of \"{name}\" is NaN or infinite"))
}
