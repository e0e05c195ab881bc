//! Motion and collisions in a tick, after the rigid discs of Chipmunk 6 as ARGoS uses them.
//!
//! A drive pulls the velocity towards its aim by at most `acceleration` x time, and Coulomb friction acts at the rims.
//! Bodies are not pushed apart: what contacts end is the approach, after the substep in which two begin to overlap. Robots
//! that nothing can touch in the tick move in closed form. For the others a tick has `PARTS` parts; in each of them all
//! drives and all contacts are solved `PASSES` times, in order, beginning with the impulses of the part before. Chipmunk
//! solves each of ten substeps ten times; beginning with its impulses fewer are enough (docs/decisions/019-arena.md).

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::contact::{PART, WallContact, square, to_face};
use super::objects::Objects;
use super::pairs::Pairs;
use super::place::Place;
use super::robot::Robot;
use super::senses::Close;
use super::swarm::{Bodies, SUBSTEP, SUBSTEPS};
use super::team::Team;

/// Parts of a tick, each of two substeps of free motion.
const PARTS: usize = 5;
/// How often drives and contacts are solved in a part.
const PASSES: usize = 2;
/// The same where there are objects, which are heavier.
const PASSES_WITH_OBJECTS: usize = 4;

/// A robot that something may touch in the tick.
#[derive(Clone, Copy)]
pub(super) struct Moved<L> {
    pub at: [Number<L>; 2],
    pub velocity: [Number<L>; 2],
    /// The velocity before this part, how far the drive alone gets in it, and what the drive gives.
    pub before: [Number<L>; 2],
    free: [Number<L>; 2],
    load: [Number<L>; 2],
}

/// The work of a tick.
pub(super) struct Contacts<L: Lanes> {
    /// The velocity that each drive aims at.
    pub aim: Vec<[Number<L>; 2]>,
    /// In which lanes something can touch a robot.
    near: Vec<L::Mask>,
    involved: Vec<u32>,
    /// In which lanes something touches a robot in this part.
    touched: Vec<L::Mask>,
    pairs: Pairs,
    /// Ascending by robots, and those of the tick before.
    walls: [Vec<WallContact<L>>; 2],
    moved: Vec<Moved<L>>,
}

/// Lines of walls that are further away at the beginning of a tick matter neither to contacts nor to rays, metres. `gap`: how
/// far robots come in a tick towards each other.
pub(super) fn reach_of_walls(robot: &Robot, gap: f32) -> f32 {
    let rays = robot.proximity.as_ref().map_or(0.0, |p| p.start + p.range);
    rays.max(robot.radius + gap / 2.0)
}

impl<L: Lanes> Contacts<L> {
    pub(super) fn new(robots: usize) -> Self {
        let zero = [number(0.0); 2];
        let moved = Moved {
            at: zero,
            velocity: zero,
            before: zero,
            free: zero,
            load: zero,
        };
        Self {
            aim: vec![zero; robots],
            near: vec![L::Mask::from_bits(0); robots],
            involved: Vec::new(),
            touched: vec![L::Mask::from_bits(0); robots],
            pairs: Pairs::new(robots),
            walls: [Vec::new(), Vec::new()],
            moved: vec![moved; robots],
        }
    }

    /// Goes to the start of an episode.
    #[inline(always)]
    pub(super) fn forget(&mut self) {
        self.pairs.forget();
        self.walls[0].clear();
    }

    /// Moves all robots by a tick.
    #[inline(always)]
    pub(super) fn resolve(
        &mut self,
        bodies: &mut Bodies<L>,
        close: &Close,
        team: &Team,
        place: &Place,
    ) {
        self.near.fill(L::Mask::from_bits(0));
        self.pairs.find(bodies, &close.robots, team, &mut self.near);
        self.find_walls(bodies, &close.faces, team, place);
        let mut objects = std::mem::take(&mut bodies.objects);
        objects.find(bodies, team, place, &mut self.near);
        self.involved.clear();
        for index in 0..bodies.len() {
            if self.near[index].any() {
                self.involved.push(index as u32);
                let moved = &mut self.moved[index];
                moved.at = [bodies.x[index], bodies.y[index]];
                moved.velocity = [bodies.vx[index], bodies.vy[index]];
            }
        }
        self.move_freely(bodies, team);
        if self.involved.is_empty() && !objects.awake() {
            bodies.objects = objects;
            return;
        }
        for _ in 0..PARTS {
            self.part(bodies, &mut objects, team, place);
        }
        bodies.objects = objects;
        for index in &self.involved {
            let index = *index as usize;
            let (near, moved) = (self.near[index], self.moved[index]);
            bodies.x[index] = moved.at[0].select(bodies.x[index], near);
            bodies.y[index] = moved.at[1].select(bodies.y[index], near);
            bodies.vx[index] = moved.velocity[0].select(bodies.vx[index], near);
            bodies.vy[index] = moved.velocity[1].select(bodies.vy[index], near);
        }
    }

    /// Finds which walls a robot may touch in this tick.
    #[inline(always)]
    fn find_walls(&mut self, bodies: &Bodies<L>, pairs: &[[u32; 2]], team: &Team, place: &Place) {
        let [now, old] = &mut self.walls;
        std::mem::swap(now, old);
        now.clear();
        let (mut first, mut at) = (0, 0);
        // Slow robots may be pushed by faster ones.
        let gap = team.gap();
        for (number_of_pair, [index, face_index]) in pairs.iter().enumerate() {
            let robot = *index as usize;
            let reach = team.robot(robot).radius + gap / 2.0;
            let face = &place.faces[*face_index as usize];
            let way = to_face(face, bodies.x[robot], bodies.y[robot]);
            let close = square(way).lt(number(reach * reach));
            if close.any() {
                self.near[robot] = self.near[robot].or(close);
                let mut lanes = close;
                for wall_contact in &mut now[first..] {
                    let taken = lanes.and(wall_contact.face.lt(number(0.0)));
                    if taken.any() {
                        wall_contact.take(*face_index, face, taken);
                        lanes = lanes.and_not(taken);
                    }
                }
                if lanes.any() {
                    let mut wall_contact = WallContact::none(*index);
                    wall_contact.take(*face_index, face, lanes);
                    now.push(wall_contact);
                }
            }
            if number_of_pair + 1 < pairs.len() && pairs[number_of_pair + 1][0] == *index {
                continue;
            }
            while at < old.len() && old[at].robot <= *index {
                if old[at].robot == *index {
                    for wall_contact in &mut now[first..] {
                        wall_contact.inherit(&old[at]);
                    }
                }
                at += 1;
            }
            first = now.len();
        }
    }

    /// A tick of robots that touch nothing, at once.
    #[inline(always)]
    fn move_freely(&mut self, bodies: &mut Bodies<L>, team: &Team) {
        for index in 0..bodies.len() {
            let most = number::<L>(team.robot(index).acceleration * SUBSTEP);
            let [ax, ay] = self.aim[index];
            let (vx, vy) = (bodies.vx[index], bodies.vy[index]);
            let (dx, dy) = (ax - vx, ay - vy);
            // The part of the change that a substep brings; infinite where there is none.
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
    fn part(&mut self, bodies: &Bodies<L>, objects: &mut Objects<L>, team: &Team, place: &Place) {
        let Self {
            aim,
            involved,
            touched,
            pairs,
            walls: [walls, _],
            moved,
            ..
        } = self;
        let fastest = team.fastest();
        let all = L::Mask::from_bits(u64::MAX);
        for index in involved.iter() {
            let index = *index as usize;
            moved[index].before = moved[index].velocity;
            touched[index] = L::Mask::from_bits(0);
        }
        pairs.begin(moved, touched, team);
        for wall_contact in walls.iter_mut() {
            let i = wall_contact.robot as usize;
            let way = wall_contact.way(moved[i].at);
            let speed = [-moved[i].before[0], -moved[i].before[1]];
            let impulse =
                wall_contact
                    .contact
                    .begin(way, speed, (team.robot(i).radius, fastest), all);
            if wall_contact.contact.active {
                pull(&mut moved[i], impulse);
                touched[i] = touched[i].or(wall_contact.contact.touches());
            }
        }
        objects.begin(moved, touched, (team, place));
        for index in involved.iter() {
            let index = *index as usize;
            drive(
                &mut moved[index],
                aim[index],
                team.robot(index).acceleration,
            );
        }
        objects.rest(false);
        let passes = if objects.any() {
            PASSES_WITH_OBJECTS
        } else {
            PASSES
        };
        for pass in 0..passes {
            if pass > 0 {
                for index in involved.iter() {
                    let index = *index as usize;
                    if touched[index].any() {
                        let limit = team.robot(index).acceleration * PART;
                        drive_on(&mut moved[index], aim[index], limit, touched[index]);
                    }
                }
                objects.rest(true);
            }
            pairs.solve(moved, touched, team);
            for wall_contact in walls.iter_mut() {
                let (i, contact) = (wall_contact.robot as usize, &mut wall_contact.contact);
                if !contact.active {
                    continue;
                }
                let [nx, ny] = contact.normal;
                let (robot, u) = (team.robot(i), moved[i].velocity);
                let approach = -(u[0] * nx + u[1] * ny);
                let slip = u[0] * ny - u[1] * nx - bodies.spin[i] * robot.radius;
                let impulse = contact.solve(approach, slip, 1.0, robot.friction[1]);
                pull(&mut moved[i], impulse);
                touched[i] = touched[i].or(contact.touches());
            }
            objects.solve(moved, touched, &bodies.spin, team);
        }
        objects.advance();
        for index in involved.iter() {
            let (moved, touched) = (&mut moved[*index as usize], touched[*index as usize]);
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

#[inline(always)]
fn pull<L: Lanes>(moved: &mut Moved<L>, [x, y]: [Number<L>; 2]) {
    moved.velocity[0] -= x;
    moved.velocity[1] -= y;
}

/// The drive pulls the velocity to its aim. `velocity` has the impulses of the contacts already: it works against them.
#[inline(always)]
fn drive<L: Lanes>(moved: &mut Moved<L>, aim: [Number<L>; 2], acceleration: f32) {
    let [x, y] = moved.velocity;
    let wanted = [aim[0] - x, aim[1] - y];
    let inverse = number::<L>(1.0) / square(wanted).sqrt();
    let whole = (inverse * (acceleration * PART)).at_most(number(1.0));
    // Of two substeps the first one still has the velocity of before.
    let half = (inverse * (acceleration * SUBSTEP)).at_most(number(1.0));
    let [vx, vy] = moved.before;
    moved.free = [
        vx * PART + wanted[0] * half * SUBSTEP,
        vy * PART + wanted[1] * half * SUBSTEP,
    ];
    moved.load = [wanted[0] * whole, wanted[1] * whole];
    push(moved, moved.load);
}

/// The drive once more, after contacts, in the lanes that have some: it gives no more than it can in all.
#[inline(always)]
fn drive_on<L: Lanes>(moved: &mut Moved<L>, aim: [Number<L>; 2], limit: f32, lanes: L::Mask) {
    let (load, [x, y]) = (moved.load, moved.velocity);
    let wanted = [load[0] + (aim[0] - x), load[1] + (aim[1] - y)];
    let part = (number::<L>(limit) / square(wanted).sqrt()).at_most(number(1.0));
    moved.load = [
        (wanted[0] * part).select(load[0], lanes),
        (wanted[1] * part).select(load[1], lanes),
    ];
    push(moved, [moved.load[0] - load[0], moved.load[1] - load[1]]);
}
