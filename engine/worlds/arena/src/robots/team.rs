//! The robots of a swarm, kind by kind, with the number of robots of each kind. All robots have the same inputs and
//! outputs.

use std::ops::Range;

use serde::Deserialize;
use serde_json::Value;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::outputs::Output;
use super::parts::Links;
use super::robot::{Group, Robot};
use super::together::{self, Own, Row};
use crate::mistakes::{Mistakes, part};
use crate::place::{LedColor, Place};

/// Maximum number of robots.
pub const MOST_ROBOTS: u32 = 100_000;
/// Maximum number of kinds of robots.
const MOST_KINDS: usize = 16;
/// Maximum ratio of masses in a contact. The heavier body counts as at most this many times as heavy as the other: for
/// larger ratios the solver has too few passes, and the lighter body would be pressed through walls.
pub const MOST_RATIO: f32 = 20.0;
/// Ratio of masses above which the solver makes more passes.
const UNEVEN: f32 = 4.0;

/// Constants of a contact between two robots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Distance between middles at which the robots touch, metres.
    pub limit: f32,
    /// Radius of the smaller robot, metres.
    pub smaller: f32,
    /// Distance between middles beyond which the robots cannot touch within a tick, metres.
    pub reach: f32,
    /// Impulse that stops an approach of 1 m/s, for robots with the mass of the first kind.
    pub share: f32,
    /// Change of each robot's velocity by an impulse that changes the velocity of a robot of the first kind by 1.
    pub lightness: [f32; 2],
    /// Coefficient of friction.
    pub friction: f32,
    /// Radius of both robots, if equal.
    pub same: Option<f32>,
}

/// All robots of a swarm, at least one.
#[derive(Debug, Clone, PartialEq)]
pub struct Team {
    groups: Vec<Group>,
    /// Group of each robot.
    of: Vec<u32>,
    /// Contact constants, for each pair of groups.
    pairs: Vec<Pair>,
    /// Whether some kind is much heavier than another.
    uneven: bool,
    /// Maximum delay of messages, in ticks.
    delay: u32,
    /// Inputs and outputs of the shared controller.
    row: Row,
}

/// A kind of robots as written in a list.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    name: Option<String>,
    robot: Value,
    count: u32,
    /// Colour of the bodies, which cameras see.
    color: Option<LedColor>,
    /// Region in which they start; by default that of the mission.
    start: Option<Value>,
}

/// Returns an error about a model given together with a list of kinds.
fn both(path: &str) -> ParameterError {
    let reason = "robots lists kinds with a robot each; leave this out or make robots a number";
    wrong(path, reason)
}

/// Reads a number of robots.
fn number(value: &Value, path: &str) -> Result<u32, ParameterError> {
    let whole = value.as_u64().or_else(|| {
        value
            .as_f64()
            .filter(|n| n.fract() == 0.0)
            .map(|n| n as u64)
    });
    let number = whole.and_then(|number| u32::try_from(number).ok());
    number
        .filter(|number| (1..=MOST_ROBOTS).contains(number))
        .ok_or_else(|| {
            let reason = format!(
                "{value} found, expected 1 to {MOST_ROBOTS}, or a list such as [{{robot: e-puck-rm1.1, count: 10}}, ..]"
            );
            wrong(path, reason)
        })
}

impl Team {
    /// Creates a team of robots of the same model.
    pub fn uniform(robot: Robot, count: u32) -> Self {
        Self::new(vec![Group {
            name: String::new(),
            robot,
            count: count as usize,
            start: None,
        }])
    }

    fn new(groups: Vec<Group>) -> Self {
        let mut of = Vec::new();
        for (index, group) in groups.iter().enumerate() {
            of.extend(std::iter::repeat_n(index as u32, group.count));
        }
        let first = groups[0].robot.mass;
        let lightness: Vec<f32> = groups
            .iter()
            .map(|group| first / group.robot.mass)
            .collect();
        let gap = groups
            .iter()
            .map(|group| group.robot.reach())
            .fold(0.0, f32::max);
        let pair = |first: usize, second: usize| {
            let (a, b) = (&groups[first].robot, &groups[second].robot);
            let limit = a.radius + b.radius;
            let lightness = [lightness[first], lightness[second]];
            let least = lightness[0].max(lightness[1]) / MOST_RATIO;
            let lightness = lightness.map(|light| light.max(least));
            Pair {
                limit,
                smaller: a.radius.min(b.radius),
                reach: limit + gap,
                share: 1.0 / (lightness[0] + lightness[1]),
                lightness,
                friction: (a.friction[0] + b.friction[0]) / 2.0,
                same: (a.radius <= b.radius && b.radius <= a.radius).then_some(a.radius),
            }
        };
        let all = 0..groups.len();
        let pairs = all
            .clone()
            .flat_map(|first| all.clone().map(move |second| (first, second)));
        let pairs: Vec<Pair> = pairs.map(|(first, second)| pair(first, second)).collect();
        let uneven = pairs.iter().any(|pair| {
            let [first, second] = pair.lightness;
            first > second * UNEVEN
        });
        let mut groups = groups;
        let row = together::arrange(&mut groups);
        let links = groups.iter().flat_map(|group| &group.robot.links);
        let delay = links.map(Links::delay).max().unwrap_or(0);
        Self {
            groups,
            of,
            pairs,
            uneven,
            delay,
            row,
        }
    }

    /// Creates the robots of a mission from `robots`, a number or a list of kinds, and `robot`, the model of all
    /// robots.
    ///
    /// # Errors
    /// Returns all mistakes in them.
    pub fn of_mission(robots: Option<&Value>, robot: Option<&Value>) -> Result<Self, Mistakes> {
        let model = Value::from("e-puck-rm1.1");
        let read_robot = || Robot::read(robot.unwrap_or(&model), "mission.robot", false);
        match robots {
            None => Ok(Self::uniform(read_robot()?, 20)),
            Some(Value::Array(items)) => {
                if robot.is_some() {
                    return Err(both("mission.robot").into());
                }
                Self::read(items, "mission.robots")
            }
            Some(count) => {
                let mut mistakes = Mistakes::default();
                let count = mistakes.take(number(count, "mission.robots"));
                let robot = mistakes.take(read_robot());
                mistakes.or(robot
                    .zip(count)
                    .map(|(robot, count)| Self::uniform(robot, count)))
            }
        }
    }

    /// Returns the robots as changed by parameters.
    ///
    /// # Errors
    /// Returns all mistakes in the parameters; also if `robots` is a number but there are several kinds.
    pub fn but(&self, robots: Option<&Value>, robot: Option<&Value>) -> Result<Self, Mistakes> {
        if let Some(Value::Array(items)) = robots {
            if robot.is_some() {
                return Err(both("robot").into());
            }
            return Self::read(items, "robots");
        }
        if robots.is_none() && robot.is_none() {
            return Ok(self.clone());
        }
        let mut mistakes = Mistakes::default();
        let model = robot.map(|robot| Robot::read(robot, "robot", false));
        let model = mistakes.take(model.transpose());
        let count = robots.map_or(Ok(self.len() as u32), |count| number(count, "robots"));
        let count = mistakes.take(count);
        let (model, count) = mistakes.or(model.zip(count))?;
        match (model, &self.groups[..]) {
            (Some(model), _) => Ok(Self::uniform(model, count)),
            (None, [group]) => Ok(Self::new(vec![Group {
                count: count as usize,
                ..group.clone()
            }])),
            (None, groups) => Err(wrong(
                "robots",
                format!(
                    "{count} found, but the mission has {} kinds of robots; expected a list such as \
                     [{{robot: {}, count: 10}}, ..], or a robot beside the number",
                    groups.len(),
                    groups[0].name
                ),
            )
            .into()),
        }
    }

    /// Reads a list of kinds; `path` is its path in error messages.
    ///
    /// # Errors
    /// Returns all mistakes in the list.
    pub fn read(items: &[Value], path: &str) -> Result<Self, Mistakes> {
        if !(1..=MOST_KINDS).contains(&items.len()) {
            let reason = format!("{} kinds found, expected 1 to {MOST_KINDS}", items.len());
            return Err(wrong(path, reason).into());
        }
        let mut mistakes = Mistakes::default();
        let mut groups: Vec<Group> = Vec::new();
        for (index, item) in items.iter().enumerate() {
            let group = Self::read_one((index, item), path, &groups);
            groups.extend(mistakes.take(group));
        }
        let groups = mistakes.or(Some(groups))?;
        let count: usize = groups.iter().map(|group| group.count).sum();
        if count > MOST_ROBOTS as usize {
            let reason = format!("{count} robots found, at most {MOST_ROBOTS} are possible");
            return Err(wrong(path, reason).into());
        }
        if groups.iter().all(|group| group.robot.message == 0) {
            // If no kind sends messages, the error names the sensor that expects some.
            for (index, item) in items.iter().enumerate() {
                Robot::read(&item["robot"], &format!("{path}[{index}].robot"), false)?;
            }
        }
        Ok(Self::new(groups))
    }

    /// Reads one item of a list of kinds.
    fn read_one(
        (index, item): (usize, &Value),
        path: &str,
        others: &[Group],
    ) -> Result<Group, Mistakes> {
        let at = format!("{path}[{index}]");
        let text: Text = part(item, &at)?;
        let mut mistakes = Mistakes::default();
        if !(1..=MOST_ROBOTS).contains(&text.count) {
            let reason = format!("{} found, expected 1 to {MOST_ROBOTS}", text.count);
            mistakes.add(wrong(&format!("{at}.count"), reason));
        }
        let mut robot = mistakes.take(Robot::read(&text.robot, &format!("{at}.robot"), true));
        if let Some(robot) = robot.as_mut() {
            if text.color.is_some() && !robot.leds.is_empty() {
                let reason = "robots with LEDs show their colours; leave the field out";
                mistakes.add(wrong(&format!("{at}.color"), reason));
            }
            robot.color = text.color;
        }
        let name = text.name.unwrap_or_else(|| match &text.robot {
            Value::String(name) => name.clone(),
            _ => format!("robot {index}"),
        });
        if name.is_empty() {
            let reason = "an empty name found; give the kind a name or leave the field out";
            mistakes.add(wrong(&format!("{at}.name"), reason));
        }
        if others.iter().any(|group| group.name == name) {
            let reason = format!("another kind is already named {name:?}; choose another name");
            mistakes.add(wrong(&format!("{at}.name"), reason));
        }
        mistakes.or(robot.map(|robot| Group {
            name,
            robot,
            count: text.count as usize,
            start: text.start,
        }))
    }

    /// Returns the number of robots.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.of.len()
    }

    #[inline]
    pub fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// Returns the names of the robot kinds, with the index range of each. Without a list, all robots are of one
    /// unnamed kind.
    pub fn named(&self) -> impl Iterator<Item = (String, Range<usize>)> + '_ {
        let mut first = 0;
        self.groups.iter().map(move |group| {
            let robots = first..first + group.count;
            first = robots.end;
            (group.name.clone(), robots)
        })
    }

    /// Returns the number of robots of a kind, or of all robots.
    pub fn count(&self, name: Option<&str>) -> usize {
        let Some(name) = name else {
            return self.len();
        };
        let entry = self.named().find(|(kind, _)| kind == name);
        entry.map_or(0, |(_, robots)| robots.len())
    }

    /// Checks that there is a kind with this name.
    pub fn check(&self, name: &str, path: &str) -> Result<(), ParameterError> {
        let names: Vec<&str> = self
            .groups
            .iter()
            .map(|group| group.name.as_str())
            .collect();
        if names.contains(&name) && !name.is_empty() {
            return Ok(());
        }
        let names = names.join(", ");
        let names = if names.is_empty() { "none" } else { &names };
        Err(wrong(
            path,
            format!(
                "no kind of robots is named {name:?}; available: {names} (named in the list robots)"
            ),
        ))
    }

    /// Returns the group of a robot.
    #[inline(always)]
    pub fn group(&self, index: usize) -> usize {
        if self.groups.len() == 1 {
            0
        } else {
            self.of[index] as usize
        }
    }

    /// Returns the model of a robot.
    #[inline(always)]
    pub fn robot(&self, index: usize) -> &Robot {
        &self.groups[self.group(index)].robot
    }

    /// Returns the model of a group.
    #[inline(always)]
    pub fn kind(&self, group: usize) -> &Robot {
        &self.groups[group].robot
    }

    fn most(&self, of: impl Fn(&Robot) -> f32) -> f32 {
        let numbers = self.groups.iter().map(|group| of(&group.robot));
        numbers.fold(0.0, f32::max)
    }

    /// Returns the maximum delay of messages, in ticks.
    pub fn delay(&self) -> u32 {
        self.delay
    }

    /// Returns the offset in the ring buffer of the messages that all robots sent `delay` ticks before `tick`.
    #[inline(always)]
    pub fn sent_at(&self, tick: u32, delay: u32) -> usize {
        let ticks = self.delay() + 1;
        let slot = (tick + ticks - delay) % ticks;
        slot as usize * self.len() * self.message()
    }

    /// Returns the largest radius, metres.
    #[inline]
    pub fn radius(&self) -> f32 {
        self.most(|robot| robot.radius)
    }

    /// Returns the distance between middles, metres, beyond which no robots can touch within a tick.
    #[inline]
    pub fn reach(&self) -> f32 {
        let reaches = self.pairs.iter().map(|pair| pair.reach);
        reaches.fold(0.0, f32::max)
    }

    /// Returns the maximum distance by which two robots approach each other in a tick, metres.
    #[inline]
    pub fn gap(&self) -> f32 {
        self.most(Robot::reach)
    }

    /// Returns the constants of a contact between two robots.
    #[inline(always)]
    pub fn pair(&self, first: usize, second: usize) -> Pair {
        self.pairs[self.group(first) * self.groups.len() + self.group(second)]
    }

    /// Returns the maximum speed at which two robots approach each other, m/s.
    #[inline]
    pub fn fastest(&self) -> f32 {
        self.most(Robot::fastest)
    }

    /// Returns the maximum distance, metres from middle to middle, at which a robot affects the sensors of another.
    #[inline]
    pub fn range(&self) -> f32 {
        let largest = self.radius();
        self.most(|robot| robot.range(largest))
    }

    /// Returns whether all robots are of one kind, and so have the same mass.
    #[inline(always)]
    pub fn equal(&self) -> bool {
        self.groups.len() == 1
    }

    /// Returns whether some kind is much heavier than another.
    #[inline(always)]
    pub fn uneven(&self) -> bool {
        self.uneven
    }

    /// Returns the number of the controllers' inputs.
    #[inline]
    pub fn sensors(&self) -> usize {
        self.row.sensors.len()
    }

    /// Returns the number of the controllers' outputs.
    #[inline]
    pub fn actuators(&self) -> usize {
        self.row.actuators.len()
    }

    /// Returns which of the controllers' outputs are for the drive of a robot.
    #[inline(always)]
    pub fn drive(&self, index: usize) -> Range<usize> {
        let first = self.row.drives[self.group(index)];
        first..first + self.robot(index).drive.actuators().len()
    }

    /// Returns the index of the first output for a robot's LEDs.
    #[inline]
    pub fn leds(&self, index: usize) -> usize {
        self.row.leds[self.group(index)]
    }

    /// Returns the index of the output for grippers; `None` if no kind has one.
    #[inline(always)]
    pub fn gripper(&self) -> Option<usize> {
        self.row.gripper
    }

    /// Returns whether any kind satisfies a predicate.
    pub fn any(&self, is: impl Fn(&Robot) -> bool) -> bool {
        self.groups.iter().any(|group| is(&group.robot))
    }

    /// Returns whether the robots come from a list of kinds.
    pub fn is_listed(&self) -> bool {
        self.groups.iter().any(|group| !group.name.is_empty())
    }

    /// Resolves references of robots to parts of the mission. `at` is their path in error messages.
    ///
    /// # Errors
    /// Returns an error if the mission lacks something.
    pub fn settle(&mut self, layout: &Place, at: &str) -> Result<(), ParameterError> {
        let listed = self.is_listed();
        for (index, group) in self.groups.iter_mut().enumerate() {
            let robot = if listed {
                format!("{at}[{index}].robot")
            } else {
                at.to_owned()
            };
            group.robot.settle(layout, &robot)?;
        }
        self.cast_shadows(layout);
        Ok(())
    }

    /// Computes how far away another robot can hide a lamp.
    fn cast_shadows(&mut self, layout: &Place) {
        let bodies = self.groups.iter();
        let bodies: Vec<_> = bodies
            .map(|Group { robot, .. }| (robot.height, robot.radius))
            .collect();
        for group in &mut self.groups {
            let Some(sensors) = &mut group.robot.light else {
                continue;
            };
            let lit = layout.lights.iter().filter(|light| light.intensity > 0.0);
            let shadows = lit.flat_map(|light| {
                let far = layout
                    .farthest(light.at)
                    .min(sensors.reach * light.intensity);
                let shadow = move |(height, radius): &(f32, f32)| {
                    far * (height / light.at[2]).min(1.0) + radius
                };
                bodies.iter().map(shadow)
            });
            // Margin for robots that are pressed slightly into walls.
            sensors.shadow = 1.01 * shadows.fold(0.0, f32::max);
        }
    }

    /// Returns the number of values in the longest message.
    #[inline(always)]
    pub fn message(&self) -> usize {
        self.row.message.len()
    }

    /// Returns the index of the first output for messages.
    pub fn message_at(&self) -> usize {
        self.row.message.start
    }

    /// Returns the largest number of encoders of a kind.
    #[inline]
    pub fn encoders(&self) -> usize {
        let encoders = |group: &Group| {
            let has_encoders = group.robot.outputs.contains(&Output::Encoders);
            if has_encoders {
                group.robot.width(Output::Encoders)
            } else {
                0
            }
        };
        self.groups.iter().map(encoders).max().unwrap_or(0)
    }

    /// Returns the names of the controllers' inputs; where kinds differ, with all their names.
    pub fn sensor_names(&self) -> Vec<String> {
        self.row.sensors.clone()
    }

    /// Returns the names of the controllers' outputs; where kinds differ, with all their names.
    pub fn actuator_names(&self) -> Vec<String> {
        self.row.actuators.clone()
    }

    /// Returns a kind's own names of its inputs and outputs.
    pub fn own_names(&self, kind: usize) -> &Own {
        &self.row.own[kind]
    }
}
