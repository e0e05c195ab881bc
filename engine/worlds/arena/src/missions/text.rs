//! Missions as written in files.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;

use crate::place::LedColor;

/// The sections of a mission, which are read separately so that all errors are reported at once.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Text {
    pub title: Option<Value>,
    pub robots: Option<Value>,
    pub duration: Option<Value>,
    pub robot: Option<Value>,
    pub walls: Option<Value>,
    pub obstacles: Option<Value>,
    pub objects: Option<Value>,
    pub floor: Option<Value>,
    pub lights: Option<Value>,
    pub start: Option<Value>,
    pub failures: Option<Value>,
    pub captures: Option<Value>,
    pub flags: Option<Value>,
    pub restart: Option<Value>,
    pub sides: Option<Value>,
    pub metrics: Option<Value>,
    pub fitness: Option<Value>,
}

fn wall_height() -> f32 {
    0.08
}

/// The outer walls.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Walls {
    /// Number of sides of a regular polygon around the origin, with one side across the x axis. Needs `apothem`.
    pub sides: Option<u32>,
    /// Distance of the polygon's sides from the origin, metres.
    pub apothem: Option<f32>,
    /// Width and height of a rectangle around the origin, metres.
    pub rectangle: Option<[f32; 2]>,
    /// Corners of a polygon, in order, metres.
    pub corners: Option<Vec<[f32; 2]>>,
    #[serde(default = "wall_height")]
    pub height: f32,
    /// Colours of parts of the sides, which cameras see.
    #[serde(default)]
    pub colors: Vec<SideColor>,
}

/// A coloured stretch of a side, which cameras see.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SideColor {
    /// Index of the side, from 0, counter-clockwise.
    pub side: usize,
    pub color: LedColor,
    /// Beginning and end, metres from the first corner of the side; by default the whole side.
    #[serde(default)]
    pub from: f32,
    pub to: Option<f32>,
}

/// A box that stands in the arena.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Obstacle {
    pub center: [f32; 2],
    /// Extent along x and y before rotation, metres.
    pub size: [f32; 2],
    /// Rotation, degrees counter-clockwise.
    #[serde(default)]
    pub angle: f32,
    #[serde(default = "wall_height")]
    pub height: f32,
    /// Colour that cameras see.
    pub color: Option<LedColor>,
}

/// An object that robots can push, or several objects at random positions.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ObjectText {
    pub name: String,
    /// Radius of a disc, metres. Alternative to `size`.
    pub radius: Option<f32>,
    /// Extent of a box along x and y before rotation, metres. Alternative to `radius`.
    pub size: Option<[f32; 2]>,
    #[serde(default = "wall_height")]
    pub height: f32,
    /// Mass, kg.
    pub mass: f32,
    /// Coefficient of friction with the floor.
    #[serde(default = "sliding")]
    pub friction: f32,
    /// Colour that cameras see.
    pub color: Option<LedColor>,
    /// Position of the middle, metres. Alternative to `start`.
    pub center: Option<[f32; 2]>,
    /// Rotation, degrees counter-clockwise.
    pub angle: Option<f32>,
    /// Region for random positions and angles. Alternative to `center`.
    pub start: Option<StartText>,
    pub count: Option<usize>,
}

fn sliding() -> f32 {
    0.3
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Floor {
    pub color: Option<Value>,
    pub patches: Option<Value>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PatchText {
    pub name: String,
    pub circle: Option<Circle>,
    pub rectangle: Option<Rectangle>,
    /// Corners of a convex polygon.
    pub polygon: Option<Vec<[f32; 2]>>,
    pub color: Color,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Circle {
    #[serde(default)]
    pub center: [f32; 2],
    pub radius: f32,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Rectangle {
    /// Left and right bounds.
    pub x: [f32; 2],
    /// Lower and upper bounds.
    pub y: [f32; 2],
}

/// The colour of the floor or of a patch.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(
    untagged,
    expecting = "expected black, grey, white, random, or a number from 0 (black) to 1 (white)"
)]
pub(super) enum Color {
    Named(Named),
    /// Grey level from 0 (black) to 1 (white).
    Level(f32),
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Named {
    Black,
    Grey,
    White,
    /// Black or white, chosen by the seed of the episode.
    Random,
}

impl Color {
    pub(super) fn level(self) -> Option<f32> {
        match self {
            Self::Named(Named::Black) => Some(0.0),
            // 127 of 255, as in ARGoS.
            Self::Named(Named::Grey) => Some(0.498_039_22),
            Self::Named(Named::White) => Some(1.0),
            Self::Named(Named::Random) => None,
            Self::Level(level) => Some(level),
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Lamp {
    pub at: [f32; 3],
    pub intensity: f32,
    /// Colour that cameras see.
    pub color: Option<LedColor>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StartText {
    pub disc: Option<Circle>,
    pub rectangle: Option<Rectangle>,
}

/// A side of a match.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SideText {
    /// Kinds of robots; by default the kind with the name of the side.
    pub robots: Option<Vec<String>>,
    /// Name of the metric that is its fitness.
    pub fitness: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(
    untagged,
    expecting = "expected the name of a metric, or {offset: NUMBER, factors: {METRIC: NUMBER, ..}}"
)]
pub(super) enum Fitness {
    /// The value of a metric.
    Metric(String),
    /// The sum of a number and metrics times factors.
    Sum(Sum),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sum {
    #[serde(default)]
    pub offset: f64,
    pub factors: BTreeMap<String, f64>,
}
