//! Motion and collisions in a tick, modelled on the rigid discs of Chipmunk 6 as used by ARGoS.
//!
//! A drive accelerates a robot towards its target velocity by at most `acceleration`, and Coulomb friction acts at the
//! rims. Contacts stop the approach after the substep in which two bodies begin to overlap; only deep overlap is pushed
//! apart. Robots that can touch nothing in the tick move in closed form. For the others a tick has `PARTS` parts; in
//! each part, all drives and all contacts are solved `PASSES` times, in order, starting from the impulses of the
//! previous part. Chipmunk solves each of ten substeps ten times; with the impulses of the previous part, fewer passes
//! are enough (docs/decisions/019-arena.md).

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::super::bodies::{Bodies, FASTEST, Objects};
use super::super::math::functions::square;
use super::super::place::Place;
use super::super::robots::Team;
use super::super::time::{PART, SUBSTEP, SUBSTEPS};
use super::contact::slow_down;
use super::near::{Close, Moved, Near};
use super::pairs::Pairs;
use super::walls::Walls;

/// Number of parts in a tick, each of two substeps of free motion.
const PARTS: usize = 5;
/// Number of times that drives and contacts are solved in a part.
const PASSES: usize = 2;
/// Number of passes if there are objects, or kinds of robots with very different masses.
const MORE_PASSES: usize = 4;
/// Maximum acceleration of a drive while something touches the robot, m/s^2: wheels slip. Without this limit, robots
/// whose drives have no limit would be pressed through each other.
const TRACTION: f32 = 10.0;

/// The state of the solver.
pub struct Contacts<L: Lanes> {
    /// Target velocity of each drive.
    pub aim: Vec<[Number<L>; 2]>,
    near: Near<L>,
    pairs: Pairs<L>,
    walls: Walls<L>,
}

impl<L: Lanes> Contacts<L> {
    pub fn new(robots: usize) -> Self {
        Self {
            aim: vec![[number(0.0); 2]; robots],
            near: Near::new(robots),
            pairs: Pairs::new(),
            walls: Walls::new(robots),
        }
    }

    /// Discards the contacts, at the start of an episode.
    #[inline(always)]
    pub fn forget(&mut self) {
        self.pairs.forget();
        self.walls.forget();
    }

    /// Moves all robots by a tick.
    #[inline(always)]
    pub fn resolve(&mut self, bodies: &mut Bodies<L>, close: &Close, team: &Team, layout: &Place) {
        let Self {
            aim,
            near: nearby,
            pairs,
            walls,
        } = self;
        nearby.lanes.fill(0);
        pairs.find(bodies, &close.robots, team, &mut nearby.lanes);
        walls.find(bodies, &close.faces, (team, layout), &mut nearby.lanes);
        let mut objects = std::mem::take(&mut bodies.objects);
        L::apart(
            #[inline(always)]
            || objects.find(bodies, team, layout, &mut nearby.lanes),
        );
        if L::WIDTH == 1 || objects.any() {
            // A single lane is always full; contacts with objects need robots in the lanes of their episodes.
            nearby.spread(bodies, aim);
        } else {
            nearby.pack(bodies, aim, team);
        }
        pairs.place(nearby);
        walls.collect(nearby, layout);
        self.move_freely(bodies, team);
        if !self.near.used.is_empty() || objects.awake() {
            for _ in 0..PARTS {
                L::apart(
                    #[inline(always)]
                    || self.part(&mut objects, team, layout),
                );
            }
            self.walls.keep();
            self.near.unpack(bodies);
        }
        bodies.objects = objects;
    }

    /// Moves the robots by a tick as if they touched nothing.
    #[inline(always)]
    fn move_freely(&mut self, bodies: &mut Bodies<L>, team: &Team) {
        for index in 0..bodies.len() {
            let most = number::<L>(team.robot(index).acceleration * SUBSTEP);
            let [ax, ay] = self.aim[index];
            let (vx, vy) = (bodies.vx[index], bodies.vy[index]);
            let (dx, dy) = (ax - vx, ay - vy);
            // Fraction of the change that one substep makes; infinite if there is no change.
            let part = most / square([dx, dy]).sqrt();
            let (mut sum, mut done) = (number(0.0), number(0.0));
            for _ in 1..SUBSTEPS {
                done += part;
                sum += done.at_most(number(1.0));
            }
            let last = (done + part).at_most(number(1.0));
            let substeps = SUBSTEPS as f32;
            bodies.x[index] += (vx * substeps + dx * sum) * SUBSTEP;
            bodies.y[index] += (vy * substeps + dy * sum) * SUBSTEP;
            bodies.vx[index] = vx + dx * last;
            bodies.vy[index] = vy + dy * last;
        }
    }

    #[inline(always)]
    fn part(&mut self, objects: &mut Objects<L>, team: &Team, layout: &Place) {
        let Self {
            near: nearby,
            pairs,
            walls,
            ..
        } = self;
        let Near { moved, used, .. } = nearby;
        for vector in used.iter() {
            let moved = &mut moved[*vector as usize];
            moved.before = moved.velocity;
            moved.touched = 0;
        }
        pairs.begin(moved, team);
        walls.begin(moved, team);
        if objects.any() {
            L::apart(
                #[inline(always)]
                || objects.begin(moved, (team, layout)),
            );
        }
        for vector in used.iter() {
            let moved = &mut moved[*vector as usize];
            drive(moved, team.robot(moved.robot as usize).acceleration);
        }
        objects.rest(false);
        let passes = if objects.any() || team.uneven() {
            MORE_PASSES
        } else {
            PASSES
        };
        for pass in 0..passes {
            if pass > 0 {
                for vector in used.iter() {
                    let moved = &mut moved[*vector as usize];
                    if moved.touched != 0 {
                        drive_on(moved, team.robot(moved.robot as usize).acceleration);
                    }
                }
                objects.rest(true);
            }
            pairs.solve(moved, team);
            walls.solve(moved, team);
            if objects.any() {
                L::apart(
                    #[inline(always)]
                    || objects.solve(moved, team),
                );
            }
        }
        objects.advance(team);
        let fastest = team.fastest();
        for vector in used.iter() {
            let moved = &mut moved[*vector as usize];
            let radius = team.robot(moved.robot as usize).radius;
            slow_down(&mut moved.velocity, (fastest / 2.0).min(radius * FASTEST));
            let touched = L::Mask::from_bits(moved.touched);
            for axis in 0..2 {
                let way = (moved.velocity[axis] * PART).select(moved.free[axis], touched);
                moved.at[axis] += way;
            }
        }
    }
}

#[inline(always)]
fn push<L: Lanes>(moved: &mut Moved<L>, [x, y]: [Number<L>; 2]) {
    moved.velocity[0] += x;
    moved.velocity[1] += y;
}

/// Applies the drive, which pulls the velocity towards its target. `velocity` already includes the impulses of
/// contacts, so the drive works against them.
#[inline(always)]
fn drive<L: Lanes>(moved: &mut Moved<L>, acceleration: f32) {
    let (aim, [x, y]) = (moved.aim, moved.velocity);
    let change = [aim[0] - x, aim[1] - y];
    let inverse = number::<L>(1.0) / square(change).sqrt();
    let mut most = number::<L>(acceleration * PART);
    if acceleration > TRACTION {
        most = number(TRACTION * PART).select(most, L::Mask::from_bits(moved.touched));
    }
    let whole = (inverse * most).at_most(number(1.0));
    // In the first of two substeps, the robot still moves at the previous velocity.
    let half = (inverse * (acceleration * SUBSTEP)).at_most(number(1.0));
    let [vx, vy] = moved.before;
    moved.free = [
        vx * PART + change[0] * half * SUBSTEP,
        vy * PART + change[1] * half * SUBSTEP,
    ];
    moved.load = [change[0] * whole, change[1] * whole];
    push(moved, moved.load);
}

/// Applies the drive again after contacts, in the lanes that have some. In total it stays within its maximum.
#[inline(always)]
fn drive_on<L: Lanes>(moved: &mut Moved<L>, acceleration: f32) {
    let lanes = L::Mask::from_bits(moved.touched);
    let (aim, load, [x, y]) = (moved.aim, moved.load, moved.velocity);
    let change = [load[0] + (aim[0] - x), load[1] + (aim[1] - y)];
    let most = number::<L>(acceleration.min(TRACTION) * PART);
    let part = (most / square(change).sqrt()).at_most(number(1.0));
    moved.load = [
        (change[0] * part).select(load[0], lanes),
        (change[1] * part).select(load[1], lanes),
    ];
    push(moved, [moved.load[0] - load[0], moved.load[1] - load[1]]);
}
