//! Proximity: rays that end at the nearest robot or wall.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::place::Place;
use super::robot::{Proximity, Robot};
use super::senses::Other;
use super::swarm::Bodies;

/// Writes the readings of a robot, without noise. A ray that begins inside of a body does not see it.
#[inline(always)]
pub(super) fn read<L: Lanes>(
    sensors: &Proximity,
    robot: &Robot,
    place: &Place,
    bodies: &Bodies<L>,
    index: usize,
    others: &[Other<L>],
    readings: &mut [Number<L>],
) {
    let zero = number(0.0);
    // While rays are followed, a reading is the distance from the start of the ray.
    readings.fill(number(sensors.range));
    let reach = sensors.start + sensors.range + robot.radius;
    for other in others {
        if !other.square.lt(number(reach * reach)).any() {
            continue;
        }
        let radius = number(robot.radius * robot.radius);
        for (ray, nearest) in sensors.rays.iter().zip(readings.iter_mut()) {
            let along = other.x * ray.along[0] + other.y * ray.along[1];
            let aside = other.x * ray.along[1] - other.y * ray.along[0];
            let depth = radius - aside * aside;
            let meets = zero.lt(depth);
            if meets.any() {
                let distance = along - depth.sqrt() - number(sensors.start);
                let seen = meets.and(zero.le(distance)).and(distance.lt(*nearest));
                *nearest = distance.select(*nearest, seen);
            }
        }
    }
    let (x, y) = (bodies.x[index], bodies.y[index]);
    let (cos, sin) = (bodies.cos[index], bodies.sin[index]);
    let reach = number(sensors.start + sensors.range);
    for face in &place.faces {
        let (dx, dy) = (x - face.middle[0], y - face.middle[1]);
        // In front of the face: its normal is `along` turned left.
        let ahead = dy * face.along[0] - dx * face.along[1];
        let side = dx * face.along[0] + dy * face.along[1];
        let far = (side - number(face.half)).at_least(-(side + face.half));
        let near = ahead.lt(reach).and(zero.lt(ahead)).and(far.lt(reach));
        if !near.any() {
            continue;
        }
        let normal = [-face.along[1], face.along[0]];
        let normal = [
            cos * normal[0] + sin * normal[1],
            cos * normal[1] - sin * normal[0],
        ];
        for (ray, nearest) in sensors.rays.iter().zip(readings.iter_mut()) {
            // How fast the ray comes nearer.
            let towards = -(normal[0] * ray.along[0] + normal[1] * ray.along[1]);
            let distance = ahead / towards - number(sensors.start);
            let hits = zero
                .lt(towards)
                .and(zero.le(distance))
                .and(distance.lt(*nearest));
            if hits.any() {
                // `along` in the frame of the robot is the normal turned right.
                let drift = normal[1] * ray.along[0] - normal[0] * ray.along[1];
                let place = side + (distance + sensors.start) * drift;
                let hits = hits
                    .and(place.le(number(face.half)))
                    .and(number(-face.half).le(place));
                *nearest = distance.select(*nearest, hits);
            }
        }
    }
    let range = number(sensors.range);
    let [c0, c1, c2] = sensors.response;
    for reading in readings {
        let distance = *reading;
        let value = ((distance * c2 + c1) * distance + c0).within(0.0, 1.0);
        *reading = value.only_where(distance.lt(range));
    }
}
