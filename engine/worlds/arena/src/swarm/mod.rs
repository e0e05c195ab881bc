//! The swarms of the episodes in all lanes, and their motion in a tick.

mod battery;
mod caught;

use swarmwright_controllers::functions::lanes::{cos_pi, sin_pi};
use swarmwright_lanes::{Int, Lanes, MOST_LANES, Mask, Number, number};

use crate::bodies::Bodies;
use crate::contacts::solver::Contacts;
use crate::failures::{Failing, Failure};
use crate::math::functions::normal;
use crate::math::random::{Keys, Purpose, halves, key};
use crate::place::{Kind, Place, Pose};
use crate::robots::{Drive, Output, Team};
use crate::rules::{CARRIES, CAUGHT, Referee, Rules};
use crate::sensing::camera;
use crate::sensing::senses::Senses;
use crate::sensing::verlet::VerletLists;
use crate::time::{SUBSTEP, SUBSTEPS};

/// The robots of a swarm with their sensors and drives.
pub struct Swarm<L: Lanes> {
    /// Robots and objects.
    pub bodies: Bodies<L>,
    /// Neighbours of each robot.
    pub verlet: VerletLists<L>,
    /// Sensors.
    pub senses: Senses<L>,
    contacts: Contacts<L>,
    keys: Keys<L>,
    failing: Failing<L>,
    referee: Referee<L>,
    /// Commands that robots carry out, if they differ from the controllers' outputs.
    told: Vec<L>,
    /// Colours of the patches of the floor.
    pub colors: Vec<Number<L>>,
    /// Current tick, from 1.
    pub tick: u32,
}

impl<L: Lanes> Swarm<L> {
    /// Allocates robots and objects; [`start`](Self::start) places them.
    #[inline(always)]
    pub fn new(team: &Team, objects: &[Kind]) -> Self {
        let robots = team.len();
        Self {
            bodies: Bodies::new(team, objects),
            verlet: VerletLists::new(robots, team.reach().max(team.range()), team.gap()),
            senses: Senses::new(team),
            contacts: Contacts::new(robots),
            keys: Keys::new(|_| key(0)),
            failing: Failing::new(),
            referee: Referee::new(),
            told: Vec::new(),
            colors: Vec::new(),
            tick: 1,
        }
    }

    /// Starts an episode in each lane. In this first tick no robot moves; the sensors are updated.
    #[inline(always)]
    pub fn start(
        &mut self,
        team: &Team,
        layout: &Place,
        (failures, rules): (&[Failure], &Rules),
        seed: impl Fn(usize) -> u64,
        mut pose: impl FnMut(usize, usize) -> Pose,
        object: impl FnMut(usize, usize) -> Pose,
    ) {
        self.keys = Keys::new(|lane| key(seed(lane)));
        self.failing.start(failures, &self.bodies, &seed);
        let mut colors = vec![[0.0; MOST_LANES]; layout.patches.len()];
        for lane in 0..L::WIDTH {
            for (lanes, color) in colors.iter_mut().zip(layout.colors(seed(lane))) {
                lanes[lane] = color;
            }
        }
        self.colors.clear();
        self.colors
            .extend(colors.iter().map(|lanes| Number::load(lanes)));
        self.tick = 1;
        let bodies = &mut self.bodies;
        for index in 0..bodies.len() {
            let mut lanes = [[0.0; MOST_LANES]; 3];
            let [x, y, heading] = &mut lanes;
            for lane in 0..L::WIDTH {
                let pose = pose(lane, index);
                [x[lane], y[lane]] = pose.at;
                heading[lane] = pose.heading;
            }
            bodies.x[index] = Number::load(x);
            bodies.y[index] = Number::load(y);
            bodies.heading[index] = Number::load(heading);
            bodies.cos[index] = Number(cos_pi(bodies.heading[index].0));
            bodies.sin[index] = Number(sin_pi(bodies.heading[index].0));
            bodies.vx[index] = number(0.0);
            bodies.vy[index] = number(0.0);
            bodies.spin[index] = number(0.0);
        }
        bodies.objects.start(object);
        self.referee.start(rules, (team, layout), bodies);
        self.contacts.forget();
        self.senses.forget(team);
        self.judge(team, layout);
        self.sense(team, layout);
    }

    /// Advances the swarm by a tick. `actuators` has the values of all robots, robot by robot, each in -1..=1.
    #[inline(always)]
    pub fn step(&mut self, team: &Team, layout: &Place, actuators: &[L]) {
        self.command(team, actuators);
        L::apart(
            #[inline(always)]
            || {
                self.contacts
                    .resolve(&mut self.bodies, &self.senses.close, team, layout);
            },
        );
        self.look(team, layout);
    }

    /// Applies the actuators, as the first part of a tick.
    #[inline(always)]
    pub fn command(&mut self, team: &Team, actuators: &[L]) {
        let mut commands = std::mem::take(&mut self.told);
        // Failures apply by the time at which the tick begins.
        let mut other = self.failing.tell(self.tick, actuators, team, &mut commands);
        self.tick += 1;
        if !self.senses.charges.is_empty() {
            if !other {
                commands.clear();
                commands.extend_from_slice(actuators);
                other = true;
            }
            battery::stop(&self.senses.charges, team.actuators(), &mut commands);
        }
        if !self.bodies.caught.is_empty() {
            if !other {
                commands.clear();
                commands.extend_from_slice(actuators);
                other = true;
            }
            caught::stop(&self.bodies.caught, team.actuators(), &mut commands);
        }
        let actuators = if other { &commands } else { actuators };
        L::apart(
            #[inline(always)]
            || self.drive(team, actuators),
        );
        if let Some(column) = team.gripper() {
            L::apart(
                #[inline(always)]
                || self.grip(team, column, actuators),
            );
        }
        self.told = commands;
    }

    /// Updates the grippers. `column` is the index of the gripper's actuator; a gripper holds while its value is above
    /// 0.
    #[inline(always)]
    fn grip(&mut self, team: &Team, column: usize, actuators: &[L]) {
        let bodies = &mut self.bodies;
        for (index, row) in actuators.chunks_exact(team.actuators()).enumerate() {
            let robot = team.robot(index);
            if let Some(reach) = robot.gripper {
                let grips = number(0.0).lt(Number(row[column]));
                let at = [bodies.x[index], bodies.y[index]];
                let objects = &mut bodies.objects;
                objects.grip(index, (at, robot.radius, reach), grips);
            }
        }
    }

    /// Updates batteries and sensors at the current poses, as the last part of a tick.
    #[inline(always)]
    pub fn look(&mut self, team: &Team, layout: &Place) {
        let charges = &mut self.senses.charges;
        if !charges.is_empty() {
            L::apart(
                #[inline(always)]
                || battery::update(team, layout, &self.bodies, &self.told, charges),
            );
        }
        self.judge(team, layout);
        let bodies = &mut self.bodies;
        for index in 0..bodies.len() {
            bodies.cos[index] = Number(cos_pi(bodies.heading[index].0));
            bodies.sin[index] = Number(sin_pi(bodies.heading[index].0));
        }
        self.sense(team, layout);
    }

    /// Applies the rules of the mission to the current poses.
    #[inline(always)]
    fn judge(&mut self, team: &Team, layout: &Place) {
        if !self.referee.is_active() {
            return;
        }
        L::apart(
            #[inline(always)]
            || {
                self.referee.update(layout, &mut self.bodies);
                self.referee
                    .show(team, &self.bodies, &mut self.senses.shown);
            },
        );
    }

    /// Computes the targets of the drives, with their noise, and rotates the robots.
    #[inline(always)]
    fn drive(&mut self, team: &Team, actuators: &[L]) {
        let bodies = &mut self.bodies;
        let encoders = team.encoders();
        let (message, message_at) = (team.message(), team.message_at());
        let mut words = [L::Int::splat(0); 4];
        for (index, row) in actuators.chunks_exact(team.actuators()).enumerate() {
            let robot = team.robot(index);
            if index % 4 == 0 {
                words = self.keys.draw(self.tick, index / 4, Purpose::Wheels);
            }
            let [length, angle] = halves(words[index % 4]);
            let noise = normal(length, angle);
            // No closures, because they would not be inlined into kernels.
            let noise = [
                noise[0] * robot.wheel_noise + 1.0,
                noise[1] * robot.wheel_noise + 1.0,
            ];
            let (cos, sin) = (bodies.cos[index], bodies.sin[index]);
            let command = &row[team.drive(index)];
            let (aim, spin) = match robot.drive {
                Drive::Differential { wheel_base } => {
                    let left = Number(command[0]) * robot.top_speed * noise[0];
                    let right = Number(command[1]) * robot.top_speed * noise[1];
                    let ahead = (left + right) * 0.5;
                    let spin = (right - left) * (1.0 / wheel_base);
                    ([ahead * cos, ahead * sin], spin)
                }
                Drive::Holonomic { turn } => {
                    let (x, y) = (Number(command[0]) * noise[0], Number(command[1]) * noise[1]);
                    // Diagonal motion is not faster than motion along an axis.
                    let length = (x * x + y * y).sqrt().at_least(number(1.0));
                    let speed = number::<L>(robot.top_speed) / length;
                    let (x, y) = (x * speed, y * speed);
                    (
                        [x * cos - y * sin, x * sin + y * cos],
                        Number(command[2]) * turn,
                    )
                }
                Drive::Car {
                    wheel_base,
                    steering,
                } => {
                    let speed = Number(command[0]) * robot.top_speed * noise[0];
                    let angle = (Number(command[1]) * steering * noise[1]).within(-0.48, 0.48);
                    let tangent = Number(sin_pi(angle.0)) / Number(cos_pi(angle.0));
                    let spin = speed * tangent * (1.0 / wheel_base);
                    ([speed * cos, speed * sin], spin)
                }
            };
            if encoders > 0 {
                let width = robot.width(Output::Encoders).min(encoders);
                let factors = [noise[0], noise[1], number(1.0)];
                for (part, factor) in factors.into_iter().enumerate().take(width) {
                    self.senses.turned[index * encoders + part] = Number(command[part]) * factor;
                }
            }
            if !robot.leds.is_empty() {
                let levels = &row[team.leds(index)..];
                self.senses.shown[index] = camera::shown(&robot.leds, levels);
            }
            let sent = &row[message_at..][..robot.message];
            let now = team.sent_at(self.tick, 0);
            for (slot, number) in self.senses.sent[now + index * message..]
                .iter_mut()
                .zip(sent)
            {
                *slot = Number(*number);
            }
            self.contacts.aim[index] = aim;
            // In the first substep, the robot still turns at the rate of the previous tick.
            let turn = (bodies.spin[index] + spin * (SUBSTEPS - 1) as f32)
                * (SUBSTEP * std::f32::consts::FRAC_1_PI);
            let heading = bodies.heading[index] + turn;
            let heading = (heading - number(2.0)).select(heading, heading.gt(number(1.0)));
            bodies.heading[index] = (heading + 2.0).select(heading, heading.lt(number(-1.0)));
            bodies.spin[index] = spin;
        }
    }

    #[inline(always)]
    fn sense(&mut self, team: &Team, layout: &Place) {
        L::apart(
            #[inline(always)]
            || self.verlet.update(&self.bodies),
        );
        let links = &mut self.senses.links;
        links.failing = self.failing.loss(self.tick);
        self.failing
            .mute(self.tick, self.bodies.len(), &mut links.mute);
        if !self.senses.charges.is_empty() {
            battery::mute(&self.senses.charges, &mut self.senses.links.mute);
        }
        if !self.bodies.caught.is_empty() {
            caught::mute::<L>(&self.bodies.caught, &mut self.senses.links.mute);
        }
        L::apart(
            #[inline(always)]
            || {
                self.senses.update(
                    &self.bodies,
                    &self.verlet,
                    team,
                    (layout, &self.colors),
                    self.keys,
                    self.tick,
                );
            },
        );
        self.failing
            .blind(self.tick, team.sensors(), &mut self.senses.outputs);
    }
}

impl Swarm<f32> {
    /// Returns the target of a drive: velocity along the axes of the arena, m/s, and angular velocity, rad/s.
    #[inline]
    pub fn aim(&self, robot: usize) -> ([f32; 2], f32) {
        let velocity = self.contacts.aim[robot].map(|number| number.0);
        (velocity, self.bodies.spin[robot].0)
    }

    /// Returns the state shown in scenes for a robot that is impaired or holds an object.
    pub fn state(&self, robot: usize) -> Option<&'static str> {
        if self
            .bodies
            .caught
            .get(robot)
            .is_some_and(|caught| caught.any())
        {
            return Some(CAUGHT);
        }
        let charge = self.senses.charges.get(robot);
        if charge.is_some_and(|charge| charge.0 <= 0.0) {
            return Some("empty");
        }
        let holds = self.bodies.objects.held_by(robot).any();
        let carries = self.bodies.carries(robot).any();
        let failing = self.failing.state(self.tick, robot);
        failing
            .or(holds.then_some("holds an object"))
            .or(carries.then_some(CARRIES))
    }

    /// Moves all robots and objects to poses that are `seconds` later.
    pub fn put(
        &mut self,
        robots: impl Iterator<Item = Pose>,
        objects: impl Iterator<Item = Pose>,
        seconds: f32,
    ) {
        let bodies = &mut self.bodies;
        for (
            index,
            Pose {
                at: [x, y],
                heading,
            },
        ) in robots.enumerate()
        {
            bodies.vx[index] = Number((x - bodies.x[index].0) / seconds);
            bodies.vy[index] = Number((y - bodies.y[index].0) / seconds);
            bodies.x[index] = Number(x);
            bodies.y[index] = Number(y);
            bodies.heading[index] = Number(heading);
        }
        bodies.objects.put(objects);
    }
}
