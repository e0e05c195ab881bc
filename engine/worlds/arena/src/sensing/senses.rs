//! Sensors of all robots in a tick, and the inputs of controllers.

use swarmwright_controllers::functions::lanes::{cos_pi, sin_pi, tanh};
use swarmwright_lanes::{Lanes, Mask, Number, number};

use super::ground::GroundWindow;
use super::links::{LinkWindow, parts};
use super::others::{Other, Others};
use super::proximity::{self, Seen};
use super::verlet::VerletLists;
use super::{camera, grey, light, messages, neighbours};
use crate::bodies::Bodies;
use crate::contacts::near::Close;
use crate::contacts::walls;
use crate::math::random::{Keys, Purpose, halves, noise, uniform};
use crate::place::{LedColor, Place};
use crate::robots::{Group, Links, Output, Team};

/// Sensor state: readings of the current robot, and inputs for the controllers of all robots.
pub struct Senses<L: Lanes> {
    /// Inputs of controllers, robot by robot.
    pub outputs: Vec<L>,
    pub close: Close,
    ground: GroundWindow<L>,
    pub links: LinkWindow<L>,
    others: Others<L>,
    /// Indices of the robots in `others`.
    indices: Vec<u32>,
    proximity: Vec<Number<L>>,
    /// Lengths of all rays, robot by robot, if another simulator measured them; empty if they are computed here.
    measured: Vec<Number<L>>,
    light: Vec<Number<L>>,
    /// Directions of proximity and light sensors as reported to controllers, by group, half turns.
    angles: Vec<[Vec<f32>; 2]>,
    seen: Seen<L>,
    /// Values of sent messages, by robot, in a ring buffer with one tick more than the maximum delay.
    pub sent: Vec<Number<L>>,
    /// Number of received messages that lack each value; empty if all messages have the same length.
    lacking: Vec<Number<L>>,
    /// Target of each drive, for encoders.
    pub turned: Vec<Number<L>>,
    /// Code of the colour that each robot shows; empty if no robot has LEDs or a camera.
    pub shown: Vec<Number<L>>,
    /// Charge of each battery; empty if no robot has one.
    pub charges: Vec<Number<L>>,
}

impl<L: Lanes> Senses<L> {
    pub fn new(team: &Team) -> Self {
        let robots = team.len();
        let angles = |group: &Group| {
            let rays = group.robot.proximity.as_ref().map_or(&[][..], |p| &p.rays);
            let lights = group.robot.light.as_ref().map_or(&[][..], |l| &l.angles);
            [
                rays.iter().map(|ray| ray.reported).collect(),
                lights.to_vec(),
            ]
        };
        let angles: Vec<[Vec<f32>; 2]> = team.groups().iter().map(angles).collect();
        let most = |part: usize| angles.iter().map(|angles| angles[part].len()).max();
        Self {
            outputs: vec![L::splat(0.0); robots * team.sensors()],
            close: Close::default(),
            ground: GroundWindow::new(robots),
            links: LinkWindow::new(robots),
            others: Others {
                all: Vec::new(),
                count: 0,
                ends: Vec::new(),
            },
            indices: Vec::new(),
            proximity: vec![number(0.0); most(0).unwrap_or(0)],
            measured: Vec::new(),
            light: vec![number(0.0); most(1).unwrap_or(0)],
            angles,
            seen: Seen::new(),
            sent: vec![number(0.0); robots * team.message() * (team.delay() as usize + 1)],
            lacking: if team.any(|robot| robot.message < robot.heard) {
                vec![number(0.0); team.message()]
            } else {
                Vec::new()
            },
            turned: vec![number(0.0); robots * team.encoders()],
            shown: if team.any(|robot| !robot.leds.is_empty() || robot.camera.is_some()) {
                vec![number(0.0); robots]
            } else {
                Vec::new()
            },
            charges: if team.any(|robot| robot.battery.is_some()) {
                vec![number(0.0); robots]
            } else {
                Vec::new()
            },
        }
    }

    /// Resets the sensors, at the start of an episode.
    #[inline(always)]
    pub fn forget(&mut self, team: &Team) {
        self.ground.clear();
        self.links.clear();
        self.measured.clear();
        self.sent.fill(number(0.0));
        self.turned.fill(number(0.0));
        for (index, shown) in self.shown.iter_mut().enumerate() {
            let color = team.robot(index).color;
            *shown = number(color.map_or(0.0, LedColor::code));
        }
        for (index, charge) in self.charges.iter_mut().enumerate() {
            // Robots without a battery are always charged.
            let battery = team.robot(index).battery.as_ref();
            *charge = number(battery.map_or(1.0, |battery| battery.charge));
        }
    }

    /// Updates the sensors of all robots at their current poses.
    #[inline(always)]
    pub fn update(
        &mut self,
        bodies: &Bodies<L>,
        verlet: &VerletLists<L>,
        team: &Team,
        (layout, colors): (&Place, &[Number<L>]),
        keys: Keys<L>,
        tick: u32,
    ) {
        let width = team.sensors();
        self.close.robots.clear();
        self.close.faces.clear();
        let (reach, largest) = (team.reach(), team.radius());
        let (encoders, gap) = (team.encoders(), team.gap());
        // Values for the kind of the current robot.
        let (mut kind, mut range, mut beside) = (usize::MAX, 0.0, number(0.0));
        for index in 0..bodies.len() {
            let (group, robot) = (team.group(index), team.robot(index));
            if group != kind {
                kind = group;
                range = robot.range(largest);
                beside = number(walls::reach_of_walls(robot, gap));
            }
            self.look_around(bodies, (verlet, team), [range.max(reach), reach], index);
            let first = self.close.faces.len();
            let (x, y) = (bodies.x[index], bodies.y[index]);
            for (face, wall) in layout.faces.iter().enumerate() {
                let ahead = wall.ahead(x, y);
                if ahead.lt(beside).and((-beside).lt(ahead)).any() {
                    self.close.faces.push([index as u32, face as u32]);
                }
            }
            let faces = &self.close.faces[first..];
            if let Some(sensors) = &robot.proximity {
                let most = self.proximity.len();
                let readings = &mut self.proximity[..sensors.rays.len()];
                if self.measured.is_empty() {
                    L::apart(
                        #[inline(always)]
                        || {
                            proximity::measure(
                                sensors,
                                team,
                                layout,
                                bodies,
                                index,
                                (&self.others, faces),
                                &mut self.seen,
                                readings,
                            );
                        },
                    );
                } else {
                    let measured = &self.measured[index * most..][..readings.len()];
                    readings.copy_from_slice(measured);
                }
                proximity::respond(sensors, readings);
                for (block, readings) in readings.chunks_mut(8).enumerate() {
                    let words = keys.draw(tick, index, Purpose::Proximity(block as u32));
                    add_noise(readings, sensors.noise, words);
                }
            }
            if let Some(sensors) = &robot.light {
                let readings = &mut self.light[..sensors.angles.len()];
                L::apart(
                    #[inline(always)]
                    || {
                        light::read(
                            sensors,
                            (team, range),
                            layout,
                            bodies,
                            index,
                            &self.others,
                            readings,
                        );
                    },
                );
                for (block, readings) in readings.chunks_mut(8).enumerate() {
                    let words = keys.draw(tick, index, Purpose::Light(block as u32));
                    add_noise(readings, sensors.noise, words);
                }
            }
            let [first, second, third, fourth] = keys.draw(tick, index, Purpose::Ground);
            let ([a, b], [c, d], [e, f]) = (halves(first), halves(second), halves(third));
            if let Some(sensors) = &robot.ground {
                let more;
                let units = if sensors.points.len() > 3 {
                    more = keys.draw(tick, index, Purpose::Floor).map(halves::<L>);
                    more.as_flattened()
                } else {
                    &[a, b, c]
                };
                self.ground
                    .read(sensors, (layout, colors), bodies, index, tick, units);
            }
            if let Some(links) = &robot.links {
                L::apart(
                    #[inline(always)]
                    || {
                        self.links.hear(
                            links,
                            team,
                            layout,
                            bodies,
                            index,
                            (&self.others, &self.indices),
                            keys,
                            tick,
                        );
                    },
                );
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
                        let [x, y] = sum_along(&self.angles[group][0], &self.proximity);
                        let length = (x * x + y * y).sqrt();
                        let long = number(1.0).lt(length);
                        let factor = (number::<L>(1.0) / length).select(number(1.0), long);
                        copy(&[x * factor, y * factor], numbers);
                    }
                    Output::LightDirection => {
                        let [x, y] = sum_along(&self.angles[group][1], &self.light);
                        let mut lit = L::Mask::from_bits(0);
                        for reading in &self.light[..self.angles[group][1].len()] {
                            lit = lit.or(number(0.2).lt(*reading));
                        }
                        let length = (x * x + y * y).sqrt();
                        let lit = lit.and(number(0.0).lt(length));
                        let factor = (number::<L>(1.0) / length).only_where(lit);
                        copy(
                            &[(x * factor).only_where(lit), (y * factor).only_where(lit)],
                            numbers,
                        );
                    }
                    Output::Ground => copy(&[self.ground.seen[index]], numbers),
                    Output::GroundDrawn => {
                        copy(&grey::drawn(self.ground.seen[index], [d, e, f]), numbers);
                    }
                    Output::MessageCount => copy(&[self.links.heard[index]], numbers),
                    Output::MessageCountSquashed => {
                        let n = self.links.heard[index];
                        copy(&[Number(tanh((n * 0.5).0))], numbers);
                    }
                    Output::Attraction => copy(&self.links.attraction[index], numbers),
                    Output::AttractionParts => {
                        copy(&parts(self.links.attraction[index]), numbers);
                    }
                    Output::GroundReadings => copy(&self.ground.readings, numbers),
                    Output::Message => {
                        let all = team.len() * team.message();
                        let delay = robot.links.as_ref().map_or(0, Links::delay);
                        let then = team.sent_at(tick, delay);
                        let sent = &self.sent[then..][..all];
                        let others = (sent, &self.others, &self.indices[..]);
                        L::apart(
                            #[inline(always)]
                            || {
                                messages::hear(
                                    (robot, team),
                                    layout,
                                    bodies,
                                    index,
                                    others,
                                    &self.links,
                                    (keys, tick),
                                    (numbers, &mut self.lacking),
                                );
                            },
                        );
                    }
                    Output::Encoders => {
                        let draw = keys.draw(tick, index, Purpose::Encoders);
                        let turned = &self.turned[index * encoders..][..width];
                        for ((number, turned), word) in numbers.iter_mut().zip(turned).zip(draw) {
                            *number = (*turned + noise(uniform(word), robot.encoder_noise)).0;
                        }
                    }
                    Output::Compass => {
                        let [word, ..] = keys.draw(tick, index, Purpose::Compass);
                        let off = noise(uniform(word), robot.compass_noise);
                        let (cos, sin) = (Number(cos_pi(off.0)), Number(sin_pi(off.0)));
                        let (x, y) = (bodies.cos[index], -bodies.sin[index]);
                        copy(&[x * cos - y * sin, x * sin + y * cos], numbers);
                    }
                    Output::NeighbourCount
                    | Output::NeighbourCenter
                    | Output::NeighbourHeading
                    | Output::NeighbourNearest => {
                        let range = robot.neighbour_range.unwrap_or(1.0);
                        let inputs = neighbours::see(
                            *output,
                            range,
                            bodies,
                            index,
                            (&self.others, &self.indices),
                        );
                        copy(&inputs, numbers);
                    }
                    Output::Camera => {
                        if let Some(camera) = &robot.camera {
                            let others = (&self.shown[..], &self.others, &self.indices[..]);
                            L::apart(
                                #[inline(always)]
                                || {
                                    camera::see(
                                        camera,
                                        (robot, team),
                                        layout,
                                        bodies,
                                        index,
                                        others,
                                        (keys, tick),
                                        numbers,
                                    );
                                },
                            );
                        }
                    }
                    Output::Battery => {
                        let [word, ..] = keys.draw(tick, index, Purpose::Battery);
                        let off = noise(uniform(word), robot.battery_noise);
                        copy(&[(self.charges[index] + off).within(0.0, 1.0)], numbers);
                    }
                    Output::Random => copy(&[uniform(fourth)], numbers),
                    Output::Gripper => {
                        let holds = bodies.objects.held_by(index);
                        copy(&[number(1.0).only_where(holds)], numbers);
                    }
                    Output::Flag => {
                        let carries = bodies.carries(index);
                        copy(&[number(1.0).only_where(carries)], numbers);
                    }
                    Output::Absent(_, neutral) => numbers.fill(L::splat(neutral.number())),
                }
                at += width;
            }
        }
    }

    /// Collects the robots within `range` of a robot in `others`, and records the pairs within `reach`.
    #[inline(always)]
    fn look_around(
        &mut self,
        bodies: &Bodies<L>,
        (verlet, team): (&VerletLists<L>, &Team),
        [range, reach]: [f32; 2],
        index: usize,
    ) {
        let Others { all, count, ends } = &mut self.others;
        *count = 0;
        ends.clear();
        let (list, kinds) = (verlet.of(index), team.groups().len());
        if all.len() < list.len() {
            let nowhere = Other {
                x: number(0.0),
                y: number(0.0),
                square: number(0.0),
            };
            all.resize(list.len(), nowhere);
            self.indices.resize(list.len(), 0);
        }
        let (all, indices) = (&mut all[..list.len()], &mut self.indices[..list.len()]);
        for other in list {
            if *other as usize == index {
                continue;
            }
            if kinds > 1 {
                let kind = team.group(*other as usize);
                while ends.len() < kind {
                    ends.push(*count);
                }
            }
            let [x, y] = bodies.between(index, *other as usize);
            let square = x * x + y * y;
            // Always written, and overwritten unless the robot is near: a branch would be unpredictable.
            all[*count] = Other { x, y, square };
            indices[*count] = *other;
            *count += usize::from(square.lt(number(range * range)).any());
            if *other as usize > index && square.lt(number(reach * reach)).any() {
                self.close.robots.push([index as u32, *other]);
            }
        }
        while ends.len() < kinds {
            ends.push(*count);
        }
    }
}

impl Senses<f32> {
    /// Stores ray lengths from another simulator, metres: for each of the `robots` robots as many as the maximum number
    /// of rays. Empty if rays are to be computed here.
    pub fn measured(&mut self, distances: &[f32], robots: usize) {
        debug_assert!(distances.is_empty() || distances.len() == robots * self.proximity.len());
        self.measured.clear();
        self.measured.extend(distances.iter().copied().map(Number));
    }
}

#[inline(always)]
fn copy<L: Lanes>(from: &[Number<L>], to: &mut [L]) {
    for index in 0..to.len() {
        to[index] = from[index].0;
    }
}

/// Adds uniform noise to up to eight readings, and limits them to 0..=1.
#[inline(always)]
fn add_noise<L: Lanes>(readings: &mut [Number<L>], extent: f32, words: [L::Int; 4]) {
    let units = [
        halves::<L>(words[0]),
        halves::<L>(words[1]),
        halves::<L>(words[2]),
        halves::<L>(words[3]),
    ];
    let units = units.as_flattened();
    if let Ok(readings) = <&mut [Number<L>; 8]>::try_from(&mut *readings) {
        // With a constant length, the compiler vectorizes this loop when there is a single lane.
        for index in 0..readings.len() {
            readings[index] = (readings[index] + noise(units[index], extent)).within(0.0, 1.0);
        }
        return;
    }
    for index in 0..readings.len() {
        readings[index] = (readings[index] + noise(units[index], extent)).within(0.0, 1.0);
    }
}

/// Returns the sum of the readings as vectors along their angles.
#[inline(always)]
fn sum_along<L: Lanes>(angles: &[f32], readings: &[Number<L>]) -> [Number<L>; 2] {
    let (mut x, mut y) = (number(0.0), number(0.0));
    for index in 0..angles.len() {
        let reading = readings[index];
        x += reading * swarmwright_controllers::functions::cos_pi(angles[index]);
        y += reading * swarmwright_controllers::functions::sin_pi(angles[index]);
    }
    [x, y]
}
