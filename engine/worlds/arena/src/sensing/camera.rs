//! The omnidirectional camera, which sees robots, lamps, coloured walls and coloured objects by their colours.

use swarmwright_controllers::functions::lanes::{cos_pi, sin_pi};
use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::links::{self, parts};
use super::others::Others;
use crate::bodies::Bodies;
use crate::math::random::{Keys, LINKS, halves, noise};
use crate::place::{LedColor, Place};
use crate::robots::{Camera, Robot, Sight, Team};

/// The things seen of one colour: their number, and the sum of 1 / (1 + range in cm) along their bearings.
#[derive(Clone, Copy)]
struct Seen<L> {
    count: Number<L>,
    sum: [Number<L>; 2],
}

/// Returns the code of the colour that LEDs show: the one with the largest number above 0, else 0.
#[inline(always)]
pub fn shown<L: Lanes>(colors: &[LedColor], numbers: &[L]) -> Number<L> {
    let (mut most, mut shown) = (number::<L>(0.0), number::<L>(0.0));
    for index in 0..colors.len() {
        let level = Number(numbers[index]);
        let more = most.lt(level);
        most = level.select(most, more);
        shown = number::<L>(colors[index].code()).select(shown, more);
    }
    shown
}

/// The view of a robot in a tick.
struct View<'a, L: Lanes> {
    camera: &'a Camera,
    team: &'a Team,
    place: &'a Place,
    bodies: &'a Bodies<L>,
    /// Index of the robot.
    index: usize,
    others: &'a Others<L>,
    keys: Keys<L>,
    tick: u32,
}

/// A thing that may be in sight.
struct Thing<L: Lanes> {
    /// Vector from the middle of the robot to the thing, metres, along the axes of the arena.
    way: [Number<L>; 2],
    /// Square of the vector's length.
    square: Number<L>,
    /// Code of the colour; 0 for none.
    color: Number<L>,
    /// Sum of the radii of the robot and the thing, centimetres.
    rims: f32,
    /// Index that addresses the noise.
    number: usize,
    /// Index among the objects, for an object, which does not hide itself.
    object: Option<usize>,
}

/// Writes the values of a robot's camera in a tick, colour by colour. `shown` has the code of each robot's colour.
#[expect(clippy::too_many_arguments, reason = "what a tick consists of")]
#[inline(always)]
pub fn see<L: Lanes>(
    camera: &Camera,
    (robot, team): (&Robot, &Team),
    layout: &Place,
    bodies: &Bodies<L>,
    index: usize,
    (shown, others, indices): (&[Number<L>], &Others<L>, &[u32]),
    (keys, tick): (Keys<L>, u32),
    numbers: &mut [L],
) {
    let nothing = Seen {
        count: number(0.0),
        sum: [number(0.0); 2],
    };
    let mut sights = [nothing; LedColor::ALL.len()];
    let view = View {
        camera,
        team,
        place: layout,
        bodies,
        index,
        others,
        keys,
        tick,
    };
    for k in 0..others.len() {
        let (other, sender) = (others[k], indices[k] as usize);
        let target = Thing {
            way: [other.x, other.y],
            square: other.square,
            color: shown[sender],
            rims: 100.0 * (robot.radius + team.robot(sender).radius),
            number: sender,
            object: None,
        };
        view.look_at(&target, &mut sights);
    }
    // Fixed things: lamps, then spots on walls.
    let lamps = layout.lights.len();
    for still in 0..lamps + layout.spots.len() {
        let (at, color) = match layout.lights.get(still) {
            Some(light) => ([light.at[0], light.at[1]], light.color),
            None => (
                layout.spots[still - lamps].at,
                Some(layout.spots[still - lamps].color),
            ),
        };
        let Some(color) = color else {
            continue;
        };
        let way = [
            number::<L>(at[0]) - bodies.x[index],
            number::<L>(at[1]) - bodies.y[index],
        ];
        let target = Thing {
            way,
            square: way[0] * way[0] + way[1] * way[1],
            color: number(color.code()),
            rims: 100.0 * robot.radius,
            number: bodies.len() + still,
            object: None,
        };
        view.look_at(&target, &mut sights);
    }
    let first = bodies.len() + lamps + layout.spots.len();
    for object in 0..bodies.objects.things.len() {
        let (item, moving) = (
            &bodies.objects.things[object],
            &bodies.objects.moving[object],
        );
        let Some(color) = item.color else {
            continue;
        };
        let way = [moving.x - bodies.x[index], moving.y - bodies.y[index]];
        let target = Thing {
            way,
            square: way[0] * way[0] + way[1] * way[1],
            color: number(color.code()),
            rims: 100.0 * (robot.radius + item.radius),
            number: first + object,
            object: Some(object),
        };
        view.look_at(&target, &mut sights);
    }
    let mut at = 0;
    for color in &camera.colors {
        let Seen { count, sum } = sights[color.index()];
        for sight in &camera.gives {
            let any = number(0.0).lt(count);
            match sight {
                Sight::Count => numbers[at] = count.0,
                Sight::Seen => numbers[at] = number::<L>(1.0).only_where(any).0,
                Sight::Attraction => {
                    numbers[at] = sum[0].0;
                    numbers[at + 1] = sum[1].0;
                }
                Sight::Direction => {
                    let length = (sum[0] * sum[0] + sum[1] * sum[1]).sqrt();
                    let any = number(0.0).lt(length);
                    let factor = (number::<L>(1.0) / length).only_where(any);
                    numbers[at] = (sum[0] * factor).0;
                    numbers[at + 1] = (sum[1] * factor).0;
                }
                Sight::Sectors => {
                    let parts = parts(sum);
                    for part in 0..parts.len() {
                        numbers[at + part] = parts[part].0;
                    }
                }
            }
            at += sight.width();
        }
    }
}

impl<L: Lanes> View<'_, L> {
    /// Adds a thing to its colour in the lanes in which it is lit, in range, and not hidden by a robot, object or wall.
    #[inline(always)]
    fn look_at(&self, target: &Thing<L>, sights: &mut [Seen<L>; LedColor::ALL.len()]) {
        let (camera, bodies, index) = (self.camera, self.bodies, self.index);
        let (way, square, color) = (target.way, target.square, target.color);
        let range = number::<L>(camera.range * camera.range);
        let lit = square.lt(range).and(number(0.0).lt(color));
        if !lit.any() {
            return;
        }
        let position = [bodies.x[index], bodies.y[index]];
        let lit = lit.and_not(links::behind_robot(self.team, way, square, self.others));
        let lit = lit.and_not(match target.object {
            Some(object) => bodies.objects.hide_object(object, position, way),
            None => bodies.objects.hide(position, way),
        });
        let lit = lit.and_not(links::behind_wall(self.place, position, way));
        if !lit.any() {
            return;
        }
        let distance = square.sqrt();
        let far = (distance * 100.0 - number(target.rims)).at_least(number(0.0)) + 1.0;
        let weight = number::<L>(1.0) / (far * distance.at_least(number(f32::MIN_POSITIVE)));
        // The vector in the frame of the robot, rotated by the noise.
        let (cos, sin) = (bodies.cos[index], bodies.sin[index]);
        let (mut x, mut y) = (
            (way[0] * cos + way[1] * sin) * weight,
            (way[1] * cos - way[0] * sin) * weight,
        );
        if camera.noise > 0.0 {
            let word =
                self.keys.seen(self.tick, index, target.number / LINKS)[target.number % LINKS / 2];
            let off = noise(halves::<L>(word)[target.number % 2], camera.noise);
            let (cos, sin) = (Number(cos_pi(off.0)), Number(sin_pi(off.0)));
            (x, y) = (x * cos - y * sin, x * sin + y * cos);
        }
        for candidate in &camera.colors {
            let code = number(candidate.code());
            let same = lit.and(color.le(code)).and(code.le(color));
            let sight = &mut sights[candidate.index()];
            sight.count = sight.count.add_where(number(1.0), same);
            sight.sum = [
                sight.sum[0].add_where(x, same),
                sight.sum[1].add_where(y, same),
            ];
        }
    }
}
