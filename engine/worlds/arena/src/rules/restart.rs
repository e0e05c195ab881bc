//! Everything returns to its start pose after an event.

use serde::Deserialize;
use swarmwright_lanes::{Lanes, Mask, Number, number};

use crate::bodies::Bodies;
use crate::place::Place;

/// All robots and objects return to their start poses in the tick after an object came to a patch.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Restart {
    pub object: String,
    /// Names of patches.
    pub on: Vec<String>,
}

/// The start poses, and the lanes in which everything returns to them in the next tick.
pub(super) struct Restarts<L: Lanes> {
    /// Indices of the objects, and of the patches to which they come.
    objects: Vec<usize>,
    patches: Vec<usize>,
    /// Start poses of robots, and of objects: position, and heading in half turns.
    robots: Vec<[Number<L>; 3]>,
    poses: Vec<[Number<L>; 3]>,
    due: L::Mask,
}

impl<L: Lanes> Restarts<L> {
    pub(super) fn new(rule: &Restart, layout: &Place, bodies: &Bodies<L>) -> Self {
        let is_named = |index: &usize| {
            let kind = bodies.objects.things[*index].kind;
            layout.objects[kind].name == rule.object
        };
        let objects = &bodies.objects;
        let moving = objects.moving.iter();
        Self {
            objects: (0..objects.things.len()).filter(is_named).collect(),
            patches: rule
                .on
                .iter()
                .filter_map(|name| layout.index(name))
                .collect(),
            robots: (0..bodies.len())
                .map(|robot| [bodies.x[robot], bodies.y[robot], bodies.heading[robot]])
                .collect(),
            poses: moving.map(|of| [of.x, of.y, of.heading]).collect(),
            due: L::Mask::from_bits(0),
        }
    }

    /// Returns everything to its start pose in the lanes in which that is due, and finds out where it is due in the
    /// next tick. Returns the lanes in which it was due.
    #[inline(always)]
    pub(super) fn update(&mut self, layout: &Place, bodies: &mut Bodies<L>) -> L::Mask {
        if self.due.any() {
            self.send_home(bodies);
        }
        let mut due = L::Mask::from_bits(0);
        for object in &self.objects {
            let moving = &bodies.objects.moving[*object];
            for patch in &self.patches {
                let shape = &layout.patches[*patch].shape;
                due = due.or(shape.holds(moving.x, moving.y));
            }
        }
        std::mem::replace(&mut self.due, due)
    }

    #[inline(always)]
    fn send_home(&self, bodies: &mut Bodies<L>) {
        let (due, zero) = (self.due, number::<L>(0.0));
        for (robot, [x, y, heading]) in self.robots.iter().enumerate() {
            bodies.x[robot] = x.select(bodies.x[robot], due);
            bodies.y[robot] = y.select(bodies.y[robot], due);
            bodies.heading[robot] = heading.select(bodies.heading[robot], due);
            bodies.vx[robot] = zero.select(bodies.vx[robot], due);
            bodies.vy[robot] = zero.select(bodies.vy[robot], due);
            bodies.spin[robot] = zero.select(bodies.spin[robot], due);
        }
        let objects = &mut bodies.objects;
        for (moving, [x, y, heading]) in objects.moving.iter_mut().zip(&self.poses) {
            moving.x = x.select(moving.x, due);
            moving.y = y.select(moving.y, due);
            for speed in &mut moving.velocity {
                *speed = zero.select(*speed, due);
            }
            moving.spin = zero.select(moving.spin, due);
            moving.turn(heading.select(moving.heading, due));
        }
        for held in &mut objects.held {
            *held = held.and_not(due);
        }
        // What pressed before presses no more.
        for touch in &mut objects.touches[0] {
            touch.pressed = zero.select(touch.pressed, due);
            touch.rubbed = zero.select(touch.rubbed, due);
        }
    }
}
