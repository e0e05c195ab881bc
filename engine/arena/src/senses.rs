//! What robots perceive in a tick, and what controllers get of it.

use swarmwright_controllers::functions::lanes::tanh;
use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::ground::GroundWindow;
use super::links::LinkWindow;
use super::neighbours::Neighbours;
use super::place::Place;
use super::random::{Keys, Purpose, halves, noise, uniform};
use super::robot::{Output, Robot};
use super::swarm::Bodies;
use super::{grey, light, proximity};

/// Another robot in the frame of the one that looks: x ahead, y to the left.
#[derive(Clone, Copy)]
pub(super) struct Other<L> {
    pub index: u32,
    pub x: Number<L>,
    pub y: Number<L>,
    pub square: Number<L>,
}

/// Readings of the robot that looks, and the numbers of all robots.
pub(super) struct Senses<L: Lanes> {
    /// Numbers for controllers, robot after robot.
    pub outputs: Vec<L>,
    ground: GroundWindow<L>,
    links: LinkWindow<L>,
    others: Vec<Other<L>>,
    proximity: Vec<Number<L>>,
    light: Vec<Number<L>>,
}

impl<L: Lanes> Senses<L> {
    pub(super) fn new(robots: usize, robot: &Robot) -> Self {
        Self {
            outputs: vec![L::splat(0.0); robots * robot.sensors()],
            ground: GroundWindow::new(robots),
            links: LinkWindow::new(robots),
            others: Vec::new(),
            proximity: vec![number(0.0); robot.proximity.as_ref().map_or(0, |p| p.rays.len())],
            light: vec![number(0.0); robot.light.as_ref().map_or(0, |l| l.angles.len())],
        }
    }

    /// Goes to the start of an episode.
    #[inline(always)]
    pub(super) fn forget(&mut self) {
        self.ground.clear();
        self.links.clear();
    }

    /// All robots look, where they are now.
    #[inline(always)]
    pub(super) fn update(
        &mut self,
        bodies: &Bodies<L>,
        neighbours: &Neighbours,
        robot: &Robot,
        (place, colors): (&Place, &[Number<L>]),
        keys: Keys<L>,
        tick: u32,
    ) {
        let width = robot.sensors();
        for index in 0..bodies.len() {
            self.look_around(bodies, neighbours, robot, index);
            if let Some(sensors) = &robot.proximity {
                proximity::read(
                    sensors,
                    robot,
                    place,
                    bodies,
                    index,
                    &self.others,
                    &mut self.proximity,
                );
                add_noise(&mut self.proximity, sensors.noise, |block| {
                    keys.draw(tick, index, Purpose::Proximity(block))
                });
            }
            if let Some(sensors) = &robot.light {
                light::read(
                    sensors,
                    robot,
                    place,
                    bodies,
                    index,
                    &self.others,
                    &mut self.light,
                );
                add_noise(&mut self.light, sensors.noise, |block| {
                    keys.draw(tick, index, Purpose::Light(block))
                });
            }
            if let Some(sensors) = &robot.ground {
                let draw = keys.draw(tick, index, Purpose::Ground);
                self.ground
                    .read(sensors, (place, colors), bodies, index, tick, draw);
            }
            if let Some(links) = &robot.links {
                self.links
                    .hear(links, robot, place, bodies, index, &self.others, keys, tick);
            }
            let outputs = &mut self.outputs[index * width..][..width];
            let mut at = 0;
            for output in &robot.outputs {
                let width = robot.width(*output);
                let numbers = &mut outputs[at..][..width];
                match output {
                    Output::Proximity => copy(&self.proximity, numbers),
                    Output::Light => copy(&self.light, numbers),
                    Output::ProximityVector => {
                        let rays = robot.proximity.as_ref().map_or(&[][..], |p| &p.rays);
                        let angles = rays.iter().map(|ray| ray.reported);
                        let [x, y] = sum_along(angles, &self.proximity);
                        let length = (x * x + y * y).sqrt();
                        let long = number(1.0).lt(length);
                        let factor = (number::<L>(1.0) / length).select(number(1.0), long);
                        copy(&[x * factor, y * factor], numbers);
                    }
                    Output::LightDirection => {
                        let angles = robot.light.as_ref().map_or(&[][..], |l| &l.angles);
                        let [x, y] = sum_along(angles.iter().copied(), &self.light);
                        let mut seen = L::Mask::from_bits(0);
                        for reading in &self.light {
                            seen = seen.or(number(0.2).lt(*reading));
                        }
                        let length = (x * x + y * y).sqrt();
                        let seen = seen.and(number(0.0).lt(length));
                        let factor = (number::<L>(1.0) / length).only_where(seen);
                        copy(
                            &[(x * factor).only_where(seen), (y * factor).only_where(seen)],
                            numbers,
                        );
                    }
                    Output::Ground => copy(&[self.ground.seen[index]], numbers),
                    Output::GroundDrawn => {
                        let draw = keys.draw(tick, index, Purpose::Grey);
                        copy(&grey::drawn(self.ground.seen[index], draw), numbers);
                    }
                    Output::Neighbours => copy(&[self.links.heard[index]], numbers),
                    Output::NeighboursSquashed => {
                        let n = self.links.heard[index];
                        copy(&[Number(tanh((n * 0.5).0))], numbers);
                    }
                    Output::Attraction => copy(&self.links.attraction[index], numbers),
                    Output::AttractionParts => {
                        copy(&parts(self.links.attraction[index]), numbers);
                    }
                    Output::Random => {
                        let [word, ..] = keys.draw(tick, index, Purpose::Given);
                        copy(&[uniform(word)], numbers);
                    }
                }
                at += width;
            }
        }
    }

    /// Fills `others` with the robots around one, in its frame.
    #[inline(always)]
    fn look_around(
        &mut self,
        bodies: &Bodies<L>,
        neighbours: &Neighbours,
        robot: &Robot,
        index: usize,
    ) {
        self.others.clear();
        let range = robot.range();
        let (cos, sin) = (bodies.cos[index], bodies.sin[index]);
        for other in neighbours.of(index) {
            let [dx, dy] = bodies.between(index, *other as usize);
            let square = dx * dx + dy * dy;
            if square.lt(number(range * range)).any() {
                self.others.push(Other {
                    index: *other,
                    x: dx * cos + dy * sin,
                    y: dy * cos - dx * sin,
                    square,
                });
            }
        }
    }
}

#[inline(always)]
fn copy<L: Lanes>(from: &[Number<L>], to: &mut [L]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = from.0;
    }
}

/// Adds uniform noise, eight readings for each draw, and limits the readings to 0..=1.
#[inline(always)]
fn add_noise<L: Lanes>(
    readings: &mut [Number<L>],
    extent: f32,
    mut draw: impl FnMut(u32) -> [L::Int; 4],
) {
    for (block, readings) in readings.chunks_mut(8).enumerate() {
        let words = draw(block as u32);
        for (word, readings) in words.into_iter().zip(readings.chunks_mut(2)) {
            for (unit, reading) in halves::<L>(word).into_iter().zip(readings) {
                *reading = (*reading + noise(unit, extent)).within(0.0, 1.0);
            }
        }
    }
}

/// The sum of readings along their angles.
#[inline(always)]
fn sum_along<L: Lanes>(
    angles: impl Iterator<Item = f32>,
    readings: &[Number<L>],
) -> [Number<L>; 2] {
    let (mut x, mut y) = (number(0.0), number(0.0));
    for (angle, reading) in angles.zip(readings) {
        x += *reading * swarmwright_controllers::functions::cos_pi(angle);
        y += *reading * swarmwright_controllers::functions::sin_pi(angle);
    }
    [x, y]
}

/// A vector squashed to the length tanh(length / 2), along the four diagonals; 0 where that is negative.
#[inline(always)]
fn parts<L: Lanes>([x, y]: [Number<L>; 2]) -> [Number<L>; 4] {
    let length = (x * x + y * y).sqrt();
    let some = number(0.0).lt(length);
    let factor = (Number(tanh((length * 0.5).0)) / length).only_where(some);
    let half = factor * std::f32::consts::FRAC_1_SQRT_2;
    let (sum, difference) = ((x + y) * half, (y - x) * half);
    [sum, difference, -sum, -difference].map(|part| part.at_least(number(0.0)))
}
