//! Light sensors: the sum over all lamps that nothing hides.

use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::others::Others;
use crate::bodies::Bodies;
use crate::math::functions::{absolute, bearing, exp};
use crate::place::{Light, Place};
use crate::robots::{LightSensors, Team};

/// Writes the light readings of a robot, without noise.
#[inline(always)]
pub fn read<L: Lanes>(
    sensors: &LightSensors,
    (team, range): (&Team, f32),
    layout: &Place,
    bodies: &Bodies<L>,
    index: usize,
    others: &Others<L>,
    readings: &mut [Number<L>],
) {
    for index in 0..readings.len() {
        readings[index] = number(0.0);
    }
    for light in &layout.lights {
        if light.intensity <= 0.0 {
            continue;
        }
        let (dx, dy) = (
            number(light.at[0]) - bodies.x[index],
            number(light.at[1]) - bodies.y[index],
        );
        let square = dx * dx + dy * dy;
        let height = light.at[2];
        let far = (square + height * height).sqrt() * (1.0 / light.intensity);
        let visible = far.le(number(sensors.reach));
        if !visible.any() {
            continue;
        }
        let distance = square.sqrt();
        let at = [bodies.x[index], bodies.y[index]];
        let hidden = behind_robot((team, range), light, [dx, dy], distance, others)
            .or(behind_wall(layout, light, at[0], at[1]))
            .or(bodies.objects.shade(at, light));
        let visible = visible.and_not(hidden);
        if !visible.any() {
            continue;
        }
        let strength = exp((far * -2.0).at_least(number(-80.0))).only_where(visible);
        // Direction of the lamp in the frame of the robot.
        let (cos, sin) = (bodies.cos[index], bodies.sin[index]);
        let angle = bearing(dx * cos + dy * sin, dy * cos - dx * sin);
        for index in 0..sensors.angles.len() {
            let reading = &mut readings[index];
            let off = absolute(angle - sensors.angles[index]);
            let off = (number(2.0) - off).select(off, number(1.0).lt(off));
            let facing = (number(1.0) - off - off).at_least(number(0.0));
            *reading += strength * facing;
        }
    }
}

/// Returns whether another robot intersects the line from the foot of the robot to a lamp. `way` points to the lamp and
/// has length `distance` in the plane.
#[inline(always)]
fn behind_robot<L: Lanes>(
    (team, range): (&Team, f32),
    light: &Light,
    way: [Number<L>; 2],
    distance: Number<L>,
    others: &Others<L>,
) -> L::Mask {
    let mut hidden = L::Mask::from_bits(0);
    let inverse = number::<L>(1.0) / distance.at_least(number(f32::MIN_POSITIVE));
    let (ux, uy) = (way[0] * inverse, way[1] * inverse);
    for kind in 0..others.kinds() {
        let robot = team.kind(kind);
        // Up to this distance the line is below the top of the robots.
        let below = distance * (robot.height / light.at[2]).min(1.0);
        let radius = number::<L>(robot.radius * robot.radius);
        let reach = (below + robot.radius).at_most(number(range));
        let reach = reach * reach;
        for other in others.of(kind) {
            let close = other.square.lt(reach);
            if !close.any() {
                continue;
            }
            let along = other.x * ux + other.y * uy;
            let aside = other.x * uy - other.y * ux;
            let depth = radius - aside * aside;
            let meets = close.and(number(0.0).lt(depth)).and(number(0.0).lt(along));
            if !meets.any() {
                continue;
            }
            // The point where the line enters the body. It must not lie before the start of the line, because a body
            // around the start does not hide the lamp.
            let entry = along - depth.at_least(number(0.0)).sqrt();
            hidden = hidden.or(meets.and(number(0.0).le(entry)).and(entry.le(below)));
        }
    }
    hidden
}

/// Returns whether a wall intersects the line to a lamp.
#[inline(always)]
fn behind_wall<L: Lanes>(layout: &Place, light: &Light, x: Number<L>, y: Number<L>) -> L::Mask {
    let mut hidden = L::Mask::from_bits(0);
    for face in &layout.faces {
        let [ax, ay] = face.along;
        let ahead = |x: f32, y: f32| (y - face.middle[1]) * ax - (x - face.middle[0]) * ay;
        let behind = ahead(light.at[0], light.at[1]);
        if behind >= 0.0 {
            continue;
        }
        let (dx, dy) = (x - face.middle[0], y - face.middle[1]);
        let front = dy * ax - dx * ay;
        // Fraction of the way at which the line enters the wall; the height there must be below the top of the wall.
        let part = front / (front - number(behind));
        let low = number(0.0)
            .lt(front)
            .and((part * light.at[2]).le(number(face.height)));
        if !low.any() {
            continue;
        }
        let side = dx * ax + dy * ay;
        let goal = (light.at[0] - face.middle[0]) * ax + (light.at[1] - face.middle[1]) * ay;
        let at = side + (number(goal) - side) * part;
        let inside = at.le(number(face.half)).and(number(-face.half).le(at));
        hidden = hidden.or(low.and(inside));
    }
    hidden
}
