//! Description of a mission's world for physics simulators.

use std::f32::consts::TAU;

use crate::place::{Form, Place, Shape};
use crate::robots::{Drive, Robot};
use crate::settings::Settings;
use crate::time::TICK;

/// Number of corners of a polygon that approximates a circle.
const CORNERS: usize = 32;

/// A wall: a closed polygon.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldWall {
    /// Corners counter-clockwise, metres.
    pub points: Vec<[f32; 2]>,
    /// Height, metres.
    pub height: f32,
}

/// A part of the floor with its own colour, for pictures and for the simulator's own sensors.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldPatch {
    /// Corners counter-clockwise, metres.
    pub points: Vec<[f32; 2]>,
    /// Grey level from 0 (black) to 1 (white); negative for black or white, drawn anew for each episode.
    pub grey: f32,
}

/// A lamp.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct WorldLight {
    /// Position along x, metres.
    pub x: f32,
    /// Position along y, metres.
    pub y: f32,
    /// Height, metres.
    pub z: f32,
    /// Intensity; the lamps of the reference model have 1.
    pub intensity: f32,
}

/// Properties of robots of one kind.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotModel {
    /// Radius, metres.
    pub radius: f32,
    /// Height, metres.
    pub height: f32,
    /// Mass, kg.
    pub mass: f32,
    /// Distance between the wheels of a differential drive, metres; 0 for other drives.
    pub wheel_base: f32,
    /// Maximum speed of a wheel, or of the robot, m/s.
    pub top_speed: f32,
    /// Maximum acceleration of the drive, m/s^2.
    pub acceleration: f32,
    /// Directions of the proximity rays, radians counter-clockwise from ahead.
    pub rays: Vec<f32>,
    /// Distance from the middle at which rays begin, metres.
    pub ray_start: f32,
    /// Length of the rays, metres.
    pub ray_range: f32,
}

/// An object that robots can push: a disc or a box.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldObject {
    /// Radius of a disc, metres; 0 for a box.
    pub radius: f32,
    /// Sides of a box along its heading and across it, metres.
    pub size: [f32; 2],
    /// Height, metres.
    pub height: f32,
    /// Mass, kg.
    pub mass: f32,
    /// Coefficient of friction with the floor.
    pub friction: f32,
}

/// Everything that a simulator has to build; the same for all episodes of a mission.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    /// Length of a step, seconds.
    pub tick: f32,
    /// Grey level of the floor outside the patches, from 0 (black) to 1 (white).
    pub grey: f32,
    /// Walls. The first one is the outline, with the robots inside; the others are obstacles.
    pub walls: Vec<WorldWall>,
    /// Patches of the floor; later patches cover earlier ones.
    pub patches: Vec<WorldPatch>,
    /// Lamps.
    pub lights: Vec<WorldLight>,
    /// The kinds of robots.
    pub models: Vec<RobotModel>,
    /// Index in `models` for each robot.
    pub robots: Vec<u32>,
    /// Objects that robots can push.
    pub objects: Vec<WorldObject>,
}

impl World {
    /// Creates the world of a mission.
    #[must_use]
    pub fn new(settings: &Settings) -> Self {
        let (layout, team) = (&settings.mission.place, &settings.team);
        let objects = layout.objects.iter().flat_map(|kind| {
            let (radius, size) = match kind.form {
                Form::Disc { radius } => (radius, [0.0; 2]),
                Form::Box { half } => (0.0, half.map(|half| 2.0 * half)),
            };
            let object = WorldObject {
                radius,
                size,
                height: kind.height,
                mass: kind.mass,
                friction: kind.friction,
            };
            std::iter::repeat_n(object, kind.count())
        });
        let lights = layout.lights.iter().map(|light| WorldLight {
            x: light.at[0],
            y: light.at[1],
            z: light.at[2],
            intensity: light.intensity,
        });
        Self {
            tick: TICK,
            grey: layout.grey,
            walls: walls(layout),
            patches: patches(layout),
            lights: lights.collect(),
            models: team.groups().iter().map(|g| model(&g.robot)).collect(),
            robots: (0..team.len())
                .map(|robot| team.group(robot) as u32)
                .collect(),
            objects: objects.collect(),
        }
    }

    /// Returns the maximum number of rays of a robot.
    #[must_use]
    pub fn most_rays(&self) -> usize {
        let rays = self.models.iter().map(|model| model.rays.len());
        rays.max().unwrap_or(0)
    }
}

fn walls(layout: &Place) -> Vec<WorldWall> {
    let boxes = layout.boxes.iter().map(|corners| corners.to_vec());
    let mut faces = layout.faces.iter();
    std::iter::once(layout.outline.clone())
        .chain(boxes)
        .map(|points| {
            // Each wall has one face per corner, in the same order.
            let height = faces.next().map_or(0.0, |face| face.height);
            faces.by_ref().take(points.len() - 1).for_each(drop);
            WorldWall { points, height }
        })
        .collect()
}

fn patches(layout: &Place) -> Vec<WorldPatch> {
    let [least, most] = layout.extent();
    let points = |shape: &Shape| match shape {
        Shape::Circle { center, radius } => (0..CORNERS)
            .map(|corner| {
                let (sin, cos) = (TAU * corner as f32 / CORNERS as f32).sin_cos();
                [center[0] + radius * cos, center[1] + radius * sin]
            })
            .collect(),
        Shape::Polygon { corners } => corners.clone(),
        Shape::Box { low, high } => {
            let [x, y] = [low[0].max(least[0]), low[1].max(least[1])];
            let [right, top] = [high[0].min(most[0]).max(x), high[1].min(most[1]).max(y)];
            vec![[x, y], [right, y], [right, top], [x, top]]
        }
    };
    let patch = |patch: &crate::place::Patch| WorldPatch {
        points: points(&patch.shape),
        grey: patch.grey.unwrap_or(-1.0),
    };
    layout.patches.iter().map(patch).collect()
}

fn model(robot: &Robot) -> RobotModel {
    let (rays, start, range) = robot.proximity.as_ref().map_or_else(
        || (Vec::new(), 0.0, 0.0),
        |sensors| {
            let rays = sensors.rays.iter();
            let angles = rays.map(|ray| ray.along[1].atan2(ray.along[0]));
            (angles.collect(), sensors.start, sensors.range)
        },
    );
    RobotModel {
        radius: robot.radius,
        height: robot.height,
        mass: robot.mass,
        wheel_base: match robot.drive {
            Drive::Differential { wheel_base } => wheel_base,
            Drive::Holonomic { .. } | Drive::Car { .. } => 0.0,
        },
        top_speed: robot.top_speed,
        acceleration: robot.acceleration,
        rays,
        ray_start: start,
        ray_range: range,
    }
}
