//! Robots that may touch something in a tick.
//!
//! The robots of all lanes are packed side by side, so that vectors are full: if half of the robots may touch
//! something, half of the vectors are enough.

use swarmwright_lanes::{Lanes, MOST_LANES, Number, lane_of, number};

use super::super::bodies::Bodies;
use super::super::robots::Team;

/// Pairs that may touch in the next tick, in any lane.
#[derive(Debug, Clone, Default)]
pub struct Close {
    /// Pairs of robots, ascending.
    pub robots: Vec<[u32; 2]>,
    /// Pairs of a robot and a face of a wall, ascending.
    pub faces: Vec<[u32; 2]>,
}

/// A vector of robots of one kind, during a tick.
#[derive(Clone, Copy)]
pub struct Moved<L> {
    /// Index of one of the robots.
    pub robot: u32,
    pub at: [Number<L>; 2],
    pub velocity: [Number<L>; 2],
    /// Velocity before this part, distance that the drive alone covers in it, and change of velocity by the drive.
    pub before: [Number<L>; 2],
    pub free: [Number<L>; 2],
    pub load: [Number<L>; 2],
    /// Target velocity of the drive.
    pub aim: [Number<L>; 2],
    pub spin: Number<L>,
    /// Lanes in which something touches the robots in this part, as bits.
    pub touched: u64,
}

/// Position of a lane's robot among the packed robots.
#[derive(Clone, Copy, Default)]
pub struct Spot {
    pub vector: u32,
    pub lane: u32,
}

/// Returns a number that orders contacts by robot, then by the other body, then by lane.
#[inline(always)]
pub fn key(robot: u32, other: u32, lane: u32) -> u64 {
    const { assert!(MOST_LANES <= 64) };
    u64::from(robot) << 32 | u64::from(other) << 6 | u64::from(lane)
}

/// All robots that may touch something in a tick.
pub struct Near<L: Lanes> {
    /// Lanes in which each robot may touch something, as bits.
    pub lanes: Vec<u64>,
    /// The packed robots, and the vectors in use.
    pub moved: Vec<Moved<L>>,
    pub used: Vec<u32>,
    /// Positions by robot and lane, for robots that may touch something.
    spots: Vec<Spot>,
}

impl<L: Lanes> Near<L> {
    pub fn new(robots: usize) -> Self {
        let zero = [number(0.0); 2];
        let moved = Moved {
            robot: 0,
            at: zero,
            velocity: zero,
            before: zero,
            free: zero,
            load: zero,
            aim: zero,
            spin: number(0.0),
            touched: 0,
        };
        Self {
            lanes: vec![0; robots],
            moved: vec![moved; robots],
            used: Vec::new(),
            spots: vec![Spot::default(); robots * L::WIDTH],
        }
    }

    /// Returns the position of a lane's robot, which must be one that may touch something.
    #[inline(always)]
    pub fn spot(&self, robot: usize, lane: usize) -> Spot {
        self.spots[robot * L::WIDTH + lane]
    }

    /// Packs the robots side by side, in ascending order, kind by kind.
    #[inline(always)]
    pub fn pack(&mut self, bodies: &Bodies<L>, aims: &[[Number<L>; 2]], team: &Team) {
        self.used.clear();
        // The current vector, its kind, and its next free lane.
        let (mut vector, mut kind, mut next) = (usize::MAX, usize::MAX, L::WIDTH);
        for (robot, aim) in aims.iter().enumerate() {
            let mut lanes = self.lanes[robot];
            if lanes == 0 {
                continue;
            }
            let group = team.group(robot);
            if group != kind {
                (kind, next) = (group, L::WIDTH);
            }
            let spots = &mut self.spots[robot * L::WIDTH..][..L::WIDTH];
            while lanes != 0 {
                let lane = lane_of::<L>(lanes.trailing_zeros());
                lanes &= lanes - 1;
                if next == L::WIDTH {
                    next = 0;
                    vector = vector.wrapping_add(1);
                    self.used.push(vector as u32);
                    self.moved[vector].robot = robot as u32;
                }
                spots[lane] = Spot {
                    vector: vector as u32,
                    lane: next as u32,
                };
                let (to, moved) = (lane_of::<L>(next as u32), &mut self.moved[vector]);
                moved.at[0].set_lane(to, bodies.x[robot].lane(lane));
                moved.at[1].set_lane(to, bodies.y[robot].lane(lane));
                moved.velocity[0].set_lane(to, bodies.vx[robot].lane(lane));
                moved.velocity[1].set_lane(to, bodies.vy[robot].lane(lane));
                moved.aim[0].set_lane(to, aim[0].lane(lane));
                moved.aim[1].set_lane(to, aim[1].lane(lane));
                moved.spin.set_lane(to, bodies.spin[robot].lane(lane));
                next += 1;
            }
        }
    }

    /// Gives each robot the vector with its own index, and keeps its lanes.
    #[inline(always)]
    pub fn spread(&mut self, bodies: &Bodies<L>, aims: &[[Number<L>; 2]]) {
        self.used.clear();
        for (robot, aim) in aims.iter().enumerate() {
            if self.lanes[robot] == 0 {
                continue;
            }
            self.used.push(robot as u32);
            for (lane, spot) in self.spots[robot * L::WIDTH..][..L::WIDTH]
                .iter_mut()
                .enumerate()
            {
                *spot = Spot {
                    vector: robot as u32,
                    lane: lane as u32,
                };
            }
            let moved = &mut self.moved[robot];
            moved.robot = robot as u32;
            moved.at = [bodies.x[robot], bodies.y[robot]];
            moved.velocity = [bodies.vx[robot], bodies.vy[robot]];
            moved.aim = *aim;
            moved.spin = bodies.spin[robot];
        }
    }

    /// Writes the positions and velocities after the tick back to the bodies.
    #[inline(always)]
    pub fn unpack(&self, bodies: &mut Bodies<L>) {
        for robot in 0..bodies.len() {
            let mut lanes = self.lanes[robot];
            let spots = &self.spots[robot * L::WIDTH..][..L::WIDTH];
            while lanes != 0 {
                let lane = lane_of::<L>(lanes.trailing_zeros());
                lanes &= lanes - 1;
                let moved = &self.moved[spots[lane].vector as usize];
                let from = lane_of::<L>(spots[lane].lane);
                bodies.x[robot].set_lane(lane, moved.at[0].lane(from));
                bodies.y[robot].set_lane(lane, moved.at[1].lane(from));
                bodies.vx[robot].set_lane(lane, moved.velocity[0].lane(from));
                bodies.vy[robot].set_lane(lane, moved.velocity[1].lane(from));
            }
        }
    }
}
