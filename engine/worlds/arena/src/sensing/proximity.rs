//! Proximity sensors: rays that end at the nearest robot, wall or object.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::others::Others;
use super::slots::Slots;
use crate::bodies::Bodies;
use crate::math::functions::absolute;
use crate::place::Place;
use crate::robots::{Proximity, Team};

/// Number of robots, or walls, that a lane collects before a pass; more need several passes.
const AT_A_TIME: usize = 4;
/// Number of lanes from which most rays hit something in some lane, so that a branch costs more than it saves.
const BRANCHLESS: usize = 8;
/// Distance of empty slots, metres, which no ray reaches.
const FAR: f32 = 1e6;

/// Things that the rays of a robot may hit.
pub struct Seen<L: Lanes> {
    /// Vectors to robots.
    robots: Slots<L, 2, AT_A_TIME>,
    /// For each face: the robot's distance in front of it and along it from its middle, half of its length, and its
    /// direction.
    faces: Slots<L, 5, AT_A_TIME>,
}

impl<L: Lanes> Seen<L> {
    pub fn new() -> Self {
        Self {
            robots: Slots::new([FAR; 2]),
            faces: Slots::new([FAR, 0.0, 0.0, 0.0, 0.0]),
        }
    }
}

/// Writes the distances at which a robot's rays end, measured from their starting points; rays that hit nothing have
/// the range of the sensor.
///
/// If a ray begins inside a body that presses against the robot, the distance is negative, or the body is not detected
/// ([`Proximity::least`]).
#[expect(
    clippy::too_many_arguments,
    reason = "what rays meet, and where they look"
)]
#[inline(always)]
pub fn measure<L: Lanes>(
    sensors: &Proximity,
    team: &Team,
    layout: &Place,
    bodies: &Bodies<L>,
    index: usize,
    (others, faces): (&Others<L>, &[[u32; 2]]),
    buffers: &mut Seen<L>,
    readings: &mut [Number<L>],
) {
    for index in 0..readings.len() {
        readings[index] = number(sensors.range);
    }
    let turn = [bodies.cos[index], bodies.sin[index]];
    let slots = &mut buffers.robots;
    for kind in 0..others.kinds() {
        let radius = team.kind(kind).radius;
        let reach = sensors.start + sensors.range + radius;
        slots.clear();
        for other in others.of(kind) {
            let close = other.square.lt(number(reach * reach));
            if close.any() {
                let rest = slots.put([other.x, other.y], close);
                if rest.any() {
                    to_robots(sensors, radius, turn, slots, readings);
                    slots.clear();
                    slots.put([other.x, other.y], rest);
                }
            }
        }
        to_robots(sensors, radius, turn, slots, readings);
    }
    let (x, y) = (bodies.x[index], bodies.y[index]);
    let reach = number(sensors.start + sensors.range);
    let slots = &mut buffers.faces;
    slots.clear();
    for [_, face] in faces {
        let face = &layout.faces[*face as usize];
        // The robot must be in front of the face; the normal is `along` rotated to the left.
        let ahead = face.ahead(x, y);
        let close = ahead.lt(reach).and(number(0.0).lt(ahead));
        if !close.any() {
            continue;
        }
        let side = (x - face.middle[0]) * face.along[0] + (y - face.middle[1]) * face.along[1];
        let beyond = (side - number(face.half)).at_least(-(side + face.half));
        let close = close.and(beyond.lt(reach));
        if !close.any() {
            continue;
        }
        let [ax, ay] = face.along;
        let wall = [ahead, side, number(face.half), number(ax), number(ay)];
        let rest = slots.put(wall, close);
        if rest.any() {
            to_walls(sensors, turn, slots, readings);
            slots.clear();
            slots.put(wall, rest);
        }
    }
    to_walls(sensors, turn, slots, readings);
    bodies.objects.shorten(sensors, bodies, index, readings);
}

/// Converts distances to readings, without noise.
#[inline(always)]
pub fn respond<L: Lanes>(sensors: &Proximity, readings: &mut [Number<L>]) {
    let range = number(sensors.range);
    let [c0, c1, c2] = sensors.response;
    for reading in readings {
        let distance = reading.at_least(number(0.0));
        let value = ((distance * c2 + c1) * distance + c0).within(0.0, 1.0);
        *reading = value.only_where(distance.lt(range));
    }
}

/// Transforms a vector to the frame of a robot with this cosine and sine of its heading.
#[inline(always)]
fn turned<L: Lanes>([cos, sin]: [Number<L>; 2], [x, y]: [Number<L>; 2]) -> [Number<L>; 2] {
    [x * cos + y * sin, y * cos - x * sin]
}

/// Shortens a ray, and the opposite ray if there is one. `distance` applies to the ray in the lanes `forward`, to the
/// opposite ray in the others, and only in the lanes `visible`.
#[inline(always)]
fn shorten<L: Lanes>(
    readings: &mut [Number<L>],
    (ray, opposite): (usize, Option<usize>),
    distance: Number<L>,
    visible: L::Mask,
    forward: L::Mask,
) {
    if L::WIDTH < BRANCHLESS && !visible.any() {
        return;
    }
    let nearest = readings[ray];
    readings[ray] = distance
        .select(nearest, visible.and(forward))
        .at_most(nearest);
    if let Some(opposite) = opposite {
        let nearest = readings[opposite];
        readings[opposite] = distance
            .select(nearest, visible.and_not(forward))
            .at_most(nearest);
    }
}

#[inline(always)]
fn to_robots<L: Lanes>(
    sensors: &Proximity,
    radius: f32,
    turn: [Number<L>; 2],
    slots: &Slots<L, 2, AT_A_TIME>,
    readings: &mut [Number<L>],
) {
    let zero = number(0.0);
    let radius = number(radius * radius);
    for slot in 0..slots.used() {
        let [x, y] = turned(turn, slots.get(slot).0);
        for index in 0..sensors.halves() {
            let ray = &sensors.rays[index];
            let along = x * ray.along[0] + y * ray.along[1];
            let aside = x * ray.along[1] - y * ray.along[0];
            let depth = radius - aside * aside;
            let meets = zero.lt(depth);
            if L::WIDTH >= BRANCHLESS || meets.any() {
                let entry = absolute(along) - depth.at_least(zero).sqrt();
                let distance = entry - number(sensors.start);
                let visible = meets.and(number(sensors.least()).le(distance));
                let rays = (index, sensors.opposite(index));
                shorten(readings, rays, distance, visible, zero.lt(along));
            }
        }
    }
}

#[inline(always)]
fn to_walls<L: Lanes>(
    sensors: &Proximity,
    turn: [Number<L>; 2],
    slots: &Slots<L, 5, AT_A_TIME>,
    readings: &mut [Number<L>],
) {
    let zero = number(0.0);
    for slot in 0..slots.used() {
        let ([ahead, side, half, ax, ay], _) = slots.get(slot);
        let [nx, ny] = turned(turn, [-ay, ax]);
        for index in 0..sensors.halves() {
            let ray = &sensors.rays[index];
            // How fast the ray approaches the wall, and how fast it drifts along it (the normal rotated to the right).
            let towards = -(nx * ray.along[0] + ny * ray.along[1]);
            let drift = ny * ray.along[0] - nx * ray.along[1];
            let whole = ahead / absolute(towards);
            let distance = whole - number(sensors.start);
            let forward = zero.lt(towards);
            let offset = side + whole.select(-whole, forward) * drift;
            let visible = number(sensors.least())
                .le(distance)
                .and(distance.lt(number(sensors.range)))
                .and(absolute(offset).le(half));
            let rays = (index, sensors.opposite(index));
            shorten(readings, rays, distance, visible, forward);
        }
    }
}
