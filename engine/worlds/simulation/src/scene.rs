//! What a simulation looks like at one moment.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

/// A picture of a two-dimensional world: what stands where.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Scene {
    /// Extent in x, metres or cells.
    pub width: f32,
    /// Extent in y, metres or cells.
    pub height: f32,
    /// Position of the bottom left corner in the simulation's own coordinates. Positions in a scene are relative to it.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub origin: [f32; 2],
    /// Whether it is a grid of cells, which people number from (0, 0) at the top left. Positions have y pointing
    /// up from the bottom left all the same.
    pub grid: bool,
    /// Steps done.
    pub step: u32,
    /// A line to show above.
    pub message: String,
    /// Everything there is, what lies below first.
    pub bodies: Vec<Body>,
    /// The floor, without points where it fills the world; none for a floor that has no colour.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<Patch>,
    /// Parts of the floor with colours of their own, what lies below first; they end where the floor ends.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub patches: Vec<Patch>,
    /// Walls and obstacles that never move.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub walls: Vec<Wall>,
    /// Lamps.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<Light>,
    /// What bodies look along.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rays: Vec<Ray>,
    /// Pairs of indices of bodies, of which the second hears the first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub links: Vec<[u32; 2]>,
    /// Looks of kinds and states that the simulation chooses itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub styles: Vec<Style>,
    /// What the values of bodies are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<Scale>,
}

/// One thing in a scene.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Body {
    /// What it is: agent, defender, goal, exit, blockade, ...
    pub kind: Cow<'static, str>,
    /// Position in x.
    pub x: f32,
    /// Position in y.
    pub y: f32,
    /// How it fares: free, arrived, caught, out, or empty.
    pub state: Cow<'static, str>,
    /// Radius, same unit as the position; 0 for a point.
    pub radius: f32,
    /// Its heading, radians counter-clockwise from the x axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading: Option<f32>,
    /// A number that gives it a colour, see [`Scale`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f32>,
    /// A short text beside it.
    #[serde(default, skip_serializing_if = "is_empty")]
    pub label: Cow<'static, str>,
    /// Which agent it is; bodies of the kind agent that do not say are the agents in their order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent: Option<u32>,
}

fn is_zero(origin: &[f32; 2]) -> bool {
    origin.iter().all(|number| number.abs() <= 0.0)
}

fn is_empty(text: &str) -> bool {
    text.is_empty()
}

/// A part of the floor: a polygon, or a circle around the only point.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Patch {
    /// Corners in order, or the middle of a circle.
    #[serde(default)]
    pub points: Vec<[f32; 2]>,
    /// Of a circle.
    #[serde(default)]
    pub radius: f32,
    /// 0 black to 1 white.
    pub grey: f32,
    /// What legends call it.
    #[serde(default)]
    pub name: String,
}

/// A line from point to point, or the corners of something solid.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Wall {
    /// Points in order, at least two.
    pub points: Vec<[f32; 2]>,
    /// Whether they are the corners of a polygon that is filled.
    #[serde(default)]
    pub solid: bool,
}

/// A lamp.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Light {
    /// Position in x.
    pub x: f32,
    /// Position in y.
    pub y: f32,
    /// 0 for a lamp that is off.
    pub intensity: f32,
}

/// A sensor's line of sight.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Ray {
    /// Index of the body that it belongs to.
    pub body: u32,
    /// Angle from the heading, radians counter-clockwise.
    pub angle: f32,
    /// Distance of its beginning from the middle of the body.
    pub start: f32,
    /// How far it goes from there.
    pub length: f32,
    /// What the sensor reads, 0..=1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reading: Option<f32>,
}

/// The look of a kind and state.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Style {
    /// Of the bodies.
    pub kind: String,
    /// Of the bodies.
    #[serde(default)]
    pub state: String,
    /// `#rrggbb`; empty for what is drawn by default.
    #[serde(default)]
    pub color: String,
    /// circle, cross, triangle, star, square, diamond, pentagon or hexagon; empty for what is drawn by default.
    #[serde(default)]
    pub shape: String,
}

/// The range of the values of bodies.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Scale {
    /// What the values are, with their unit.
    pub name: String,
    /// The value with the first colour.
    pub low: f32,
    /// The value with the last colour.
    pub high: f32,
}
