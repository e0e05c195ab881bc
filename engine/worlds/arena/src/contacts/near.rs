//! Robots that something may touch in a tick. Those of all lanes are put side by side, so that vectors are full of them:
//! where half of the robots touch something, that takes half of the vectors.

use swarmwright_lanes::{Lanes, MOST_LANES, Number, lane_of, number};

use super::super::bodies::Bodies;
use super::super::robots::Team;

/// What may touch in the next tick, in any lane.
#[derive(Debug, Clone, Default)]
pub(crate) struct Close {
    /// Two robots, ascending.
    pub robots: Vec<[u32; 2]>,
    /// A robot and a face of a wall, ascending.
    pub faces: Vec<[u32; 2]>,
}

/// A vector of robots of one kind, while they move in a tick.
#[derive(Clone, Copy)]
pub(crate) struct Moved<L> {
    /// One of them.
    pub robot: u32,
    pub at: [Number<L>; 2],
    pub velocity: [Number<L>; 2],
    /// The velocity before this part, how far the drive alone gets in it, and what the drive gives.
    pub before: [Number<L>; 2],
    pub free: [Number<L>; 2],
    pub load: [Number<L>; 2],
    /// What the drive aims at.
    pub aim: [Number<L>; 2],
    pub spin: Number<L>,
    /// In which lanes something touches them in this part, as bits.
    pub touched: u64,
}

/// Index of a lane's robot among the moving robots.
#[derive(Clone, Copy, Default)]
pub(crate) struct Spot {
    pub vector: u32,
    pub lane: u32,
}

/// Orders contacts by robots, then by what each touches, then by lanes: a number, which is compared at once.
#[inline(always)]
pub(crate) fn key(robot: u32, other: u32, lane: u32) -> u64 {
    const { assert!(MOST_LANES <= 64) };
    u64::from(robot) << 32 | u64::from(other) << 6 | u64::from(lane)
}

/// All robots that something may touch in a tick.
pub(crate) struct Near<L: Lanes> {
    /// By robot: in which lanes something can touch it, as bits.
    pub lanes: Vec<u64>,
    /// The robots, and which vectors are in use.
    pub moved: Vec<Moved<L>>,
    pub used: Vec<u32>,
    /// By robot and lane, of those that something can touch.
    spots: Vec<Spot>,
}

impl<L: Lanes> Near<L> {
    pub(crate) fn new(robots: usize) -> Self {
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

    /// Where a robot of a lane is, in which something can touch it.
    #[inline(always)]
    pub(crate) fn spot(&self, robot: usize, lane: usize) -> Spot {
        self.spots[robot * L::WIDTH + lane]
    }

    /// Puts the robots side by side, in ascending order, kind by kind.
    #[inline(always)]
    pub(crate) fn pack(&mut self, bodies: &Bodies<L>, aims: &[[Number<L>; 2]], team: &Team) {
        self.used.clear();
        // The vector that is filled, its kind, and its next lane.
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

    /// Gives each robot the vector of its own number, in which lanes stay where they are.
    #[inline(always)]
    pub(crate) fn spread(&mut self, bodies: &Bodies<L>, aims: &[[Number<L>; 2]]) {
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

    /// Tells bodies where the robots are after the tick.
    #[inline(always)]
    pub(crate) fn unpack(&self, bodies: &mut Bodies<L>) {
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
