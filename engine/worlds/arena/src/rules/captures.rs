//! Robots that catch others.

use std::ops::Range;

use serde::Deserialize;
use swarmwright_lanes::{Lanes, Mask, number};

use crate::bodies::Bodies;
use crate::robots::Team;

/// Robots of a kind are caught as soon as one of another kind is near: from then on they stand, show no colour and are
/// not heard.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Capture {
    /// The kind that is caught.
    pub robots: String,
    /// The kind that catches.
    pub by: String,
    /// Distance between the rims, metres.
    pub reach: f32,
}

/// Robots that are caught, those that catch them, and the square of the distance between their middles, m^2.
#[derive(Debug, Clone)]
struct Chase {
    hunted: Range<usize>,
    hunters: Range<usize>,
    square: f32,
}

/// The chases of a mission.
#[derive(Debug, Clone, Default)]
pub(super) struct Captures(Vec<Chase>);

impl Captures {
    /// Finds the robots of each rule. No robot is caught yet.
    pub(super) fn new<L: Lanes>(rules: &[Capture], team: &Team, bodies: &mut Bodies<L>) -> Self {
        let chase = |rule: &Capture| {
            let (hunted, hunters) = (
                bodies.named(Some(&rule.robots)),
                bodies.named(Some(&rule.by)),
            );
            let radius = |robots: &Range<usize>| match robots.is_empty() {
                true => 0.0,
                false => team.robot(robots.start).radius,
            };
            let far = radius(&hunted) + radius(&hunters) + rule.reach;
            Chase {
                hunted,
                hunters,
                square: far * far,
            }
        };
        let chases = rules.iter().map(chase).collect();
        if !rules.is_empty() {
            bodies.caught.resize(bodies.len(), L::Mask::from_bits(0));
        }
        Self(chases)
    }

    /// Adds the robots that are caught now. A robot that is caught itself catches nobody.
    #[inline(always)]
    pub(super) fn update<L: Lanes>(&self, bodies: &mut Bodies<L>) {
        for chase in &self.0 {
            for robot in chase.hunted.clone() {
                let mut caught = bodies.caught[robot];
                for hunter in chase.hunters.clone() {
                    let [x, y] = bodies.between(robot, hunter);
                    let close = (x * x + y * y).le(number(chase.square));
                    caught = caught.or(close.and_not(bodies.caught[hunter]));
                }
                bodies.caught[robot] = caught;
            }
        }
    }
}
