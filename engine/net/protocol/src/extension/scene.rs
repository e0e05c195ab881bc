//! What a simulation looks like at one step, for tools that show episodes of simulations that they do not have.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{F32s, U32s};
use crate::DecodeError;

/// In [`Bodies::agent`]: the body is none of the agents.
pub const NO_AGENT: u32 = u32::MAX;

/// Shapes that a style can have.
const SHAPES: [&str; 9] = [
    "", "circle", "cross", "triangle", "star", "square", "diamond", "pentagon", "hexagon",
];
/// More kinds and states than this are a mistake of the server.
const MOST_LOOKS: usize = 1000;

/// Server to tool: the scene of an episode before its first step, and after each.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SceneMessage {
    /// [`EXTENSION_VERSION`](super::EXTENSION_VERSION).
    pub version: u64,
    /// The server's id.
    pub server: u64,
    /// Of the control message that started the episode.
    pub simulation_hash: String,
    /// Steps done.
    pub step: u64,
    /// Fitness so far.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitness: Option<f64>,
    /// Metrics so far.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, f64>,
    /// For how long it is to be seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Extent in x.
    pub width: f32,
    /// Extent in y.
    pub height: f32,
    /// Position of (0, 0) in the simulation's own coordinates; by default (0, 0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<[f32; 2]>,
    /// Whether the unit is a cell, not a metre.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub grid: bool,
    /// A line to show above.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub message: String,
    /// The bodies, from bottom to top.
    pub bodies: Bodies,
    /// What bodies look along.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rays: Option<Rays>,
    /// Pairs of indices of bodies, of which the second hears the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub links: Option<U32s>,
    /// The floor; without points where it fills the world.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<ScenePatch>,
    /// Parts of the floor.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub patches: Vec<ScenePatch>,
    /// What never moves.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub walls: Vec<SceneWall>,
    /// Lamps.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<SceneLight>,
    /// Looks of kinds and states.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub styles: Vec<SceneStyle>,
    /// What the values of bodies are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<SceneScale>,
}

/// Bodies as arrays, one number for each.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Bodies {
    /// Pairs of kind and state.
    pub looks: Vec<[String; 2]>,
    /// Which of them each has; the first one, where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub look: Option<U32s>,
    /// Positions.
    pub x: F32s,
    /// Positions, upwards.
    pub y: F32s,
    /// Of each, or one of all; points where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius: Option<F32s>,
    /// Radians counter-clockwise from the x axis; NaN for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading: Option<F32s>,
    /// Numbers that give colours; NaN for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<F32s>,
    /// Agent of each body; [`NO_AGENT`] for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent: Option<U32s>,
    /// Short texts.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub labels: Vec<String>,
}

/// Lines of sight as arrays, one number for each.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Rays {
    /// Index of the body.
    pub body: U32s,
    /// Angle from the heading, radians counter-clockwise.
    pub angle: F32s,
    /// Distance of their beginning from the middle of the body.
    pub start: F32s,
    /// How far they go from there.
    pub length: F32s,
    /// What the sensor reads, 0 to 1; NaN for nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reading: Option<F32s>,
}

/// A part of the floor: a polygon, or a circle around the only point.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ScenePatch {
    /// 0 black to 1 white.
    pub grey: f32,
    /// Corners in order, or the middle of a circle.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<[f32; 2]>,
    /// Of a circle.
    #[serde(default)]
    pub radius: f32,
    /// What legends call it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
}

/// A line from point to point, or the corners of something solid.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SceneWall {
    /// At least two.
    pub points: Vec<[f32; 2]>,
    /// Whether they are the corners of a polygon that is filled.
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
    /// 0 for a lamp that is off.
    #[serde(default = "one")]
    pub intensity: f32,
}

fn one() -> f32 {
    1.0
}

/// The look of bodies of a kind and state.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SceneStyle {
    /// Of the bodies.
    pub kind: String,
    /// Of the bodies; empty for all states without a style.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub state: String,
    /// `#rrggbb`; empty for the default.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub color: String,
    /// circle, cross, triangle, star, square, diamond, pentagon or hexagon; empty for the default.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub shape: String,
}

/// The range of the values of bodies.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SceneScale {
    /// With the unit.
    pub name: String,
    /// The value with the first colour.
    pub low: f32,
    /// The value with the last colour.
    pub high: f32,
}

impl SceneMessage {
    /// Bytes that its arrays take, about.
    pub(super) fn numbers(&self) -> usize {
        let rays = self.rays.as_ref().map_or(0, |rays| rays.body.0.len());
        let links = self.links.as_ref().map_or(0, |links| links.0.len());
        28 * self.bodies.x.0.len() + 20 * rays + 4 * links
    }

    /// What no type says: arrays fit each other, indices point at something, numbers are finite.
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
