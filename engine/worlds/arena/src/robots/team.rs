//! The robots of a swarm, kind after kind, each with a number of robots. All have the same rows of numbers.

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
use crate::place::Place;

/// Most robots.
pub(crate) const MOST_ROBOTS: u32 = 100_000;
/// Most kinds of robots.
const MOST_KINDS: usize = 16;
/// Where bodies touch, the heavier one counts as at most so many times as heavy as the other: few passes of the solver are
/// not enough for larger ratios, and the light one would be pressed through walls.
pub(crate) const MOST_RATIO: f32 = 20.0;
/// Masses whose ratio is larger take more passes.
const UNEVEN: f32 = 4.0;

/// What matters where a robot touches another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pair {
    /// Distance of middles at which they touch, metres.
    pub limit: f32,
    /// The radius of the smaller one, metres.
    pub smaller: f32,
    /// Middles that are further apart at the beginning of a tick do not touch in it, metres.
    pub reach: f32,
    /// Impulse that ends an approach of 1 m/s, for robots with the mass of the first kind.
    pub share: f32,
    /// The change of velocity of each by an impulse that changes that of a robot of the first kind by 1.
    pub lightness: [f32; 2],
    /// Coefficient of friction.
    pub friction: f32,
    /// The radius of both, where it is the same.
    pub same: Option<f32>,
}

/// All robots, at least one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Team {
    groups: Vec<Group>,
    /// By robot: its group.
    of: Vec<u32>,
    /// By group and group.
    pairs: Vec<Pair>,
    /// Whether a kind is much heavier than another one.
    uneven: bool,
    /// Ticks that the slowest messages take.
    delay: u32,
    /// What the controller of all gets and gives.
    row: Row,
}

/// A kind of robots as it is written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    name: Option<String>,
    robot: Value,
    count: u32,
}

/// A complaint about a model beside a list of kinds.
fn both(path: &str) -> ParameterError {
    let reason = "robots lists kinds with a robot each; leave this out or make robots a number";
    wrong(path, reason)
}

/// A number of robots.
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
    /// Robots of the same model.
    pub(crate) fn uniform(robot: Robot, count: u32) -> Self {
        Self::new(vec![Group {
            name: String::new(),
            robot,
            count: count as usize,
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

    /// The robots of a mission: `robots`, a number or a list of kinds, and `robot`, the model of all.
    ///
    /// # Errors
    /// All that is wrong with them.
    pub(crate) fn of_mission(
        robots: Option<&Value>,
        robot: Option<&Value>,
    ) -> Result<Self, Mistakes> {
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

    /// The robots where parameters say others.
    ///
    /// # Errors
    /// All that is wrong with the parameters; a number where the robots are of several kinds.
    pub(crate) fn but(
        &self,
        robots: Option<&Value>,
        robot: Option<&Value>,
    ) -> Result<Self, Mistakes> {
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
    /// All that is wrong with it.
    pub(crate) fn read(items: &[Value], path: &str) -> Result<Self, Mistakes> {
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
            // No kind sends messages: the complaint names the sensor of the kind that is to hear some.
            for (index, item) in items.iter().enumerate() {
                Robot::read(&item["robot"], &format!("{path}[{index}].robot"), false)?;
            }
        }
        Ok(Self::new(groups))
    }

    /// Reads one of a list of kinds.
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
        let robot = mistakes.take(Robot::read(&text.robot, &format!("{at}.robot"), true));
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
        }))
    }

    /// Number of robots.
    #[inline(always)]
    pub(crate) fn len(&self) -> usize {
        self.of.len()
    }

    pub(crate) fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// Names of the robot kinds, with the index range of each; without a list, all robots are of one unnamed kind.
    pub(crate) fn named(&self) -> impl Iterator<Item = (String, Range<usize>)> + '_ {
        let mut first = 0;
        self.groups.iter().map(move |group| {
            let robots = first..first + group.count;
            first = robots.end;
            (group.name.clone(), robots)
        })
    }

    /// How many robots of a kind there are, or in all.
    pub(crate) fn count(&self, name: Option<&str>) -> usize {
        let Some(name) = name else {
            return self.len();
        };
        let entry = self.named().find(|(kind, _)| kind == name);
        entry.map_or(0, |(_, robots)| robots.len())
    }

    /// Checks that there is a kind with this name.
    pub(crate) fn check(&self, name: &str, path: &str) -> Result<(), ParameterError> {
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

    /// The group of a robot.
    #[inline(always)]
    pub(crate) fn group(&self, index: usize) -> usize {
        if self.groups.len() == 1 {
            0
        } else {
            self.of[index] as usize
        }
    }

    /// What a robot is.
    #[inline(always)]
    pub(crate) fn robot(&self, index: usize) -> &Robot {
        &self.groups[self.group(index)].robot
    }

    /// What a robot of a group is.
    #[inline(always)]
    pub(crate) fn kind(&self, group: usize) -> &Robot {
        &self.groups[group].robot
    }

    fn most(&self, of: impl Fn(&Robot) -> f32) -> f32 {
        let numbers = self.groups.iter().map(|group| of(&group.robot));
        numbers.fold(0.0, f32::max)
    }

    /// Ticks that the slowest messages take.
    pub(crate) fn delay(&self) -> u32 {
        self.delay
    }

    /// Offset of all robots' messages that were sent a number of ticks before a tick, in the ring buffer.
    #[inline(always)]
    pub(crate) fn sent_at(&self, tick: u32, delay: u32) -> usize {
        let ticks = self.delay() + 1;
        let slot = (tick + ticks - delay) % ticks;
        slot as usize * self.len() * self.message()
    }

    /// The largest radius, metres.
    pub(crate) fn radius(&self) -> f32 {
        self.most(|robot| robot.radius)
    }

    /// Middles that are further apart than this at the beginning of a tick do not touch in it, metres.
    pub(crate) fn reach(&self) -> f32 {
        let reaches = self.pairs.iter().map(|pair| pair.reach);
        reaches.fold(0.0, f32::max)
    }

    /// How far robots come towards each other in a tick at most, metres.
    pub(crate) fn gap(&self) -> f32 {
        self.most(Robot::reach)
    }

    /// What matters where a robot touches another.
    #[inline(always)]
    pub(crate) fn pair(&self, first: usize, second: usize) -> Pair {
        self.pairs[self.group(first) * self.groups.len() + self.group(second)]
    }

    /// No two robots approach each other faster, m/s.
    pub(crate) fn fastest(&self) -> f32 {
        self.most(Robot::fastest)
    }

    /// How far anything of another robot matters to the sensors of any, metres from middle to middle.
    pub(crate) fn range(&self) -> f32 {
        let largest = self.radius();
        self.most(|robot| robot.range(largest))
    }

    /// Whether all weigh the same.
    #[inline(always)]
    pub(crate) fn equal(&self) -> bool {
        self.groups.len() == 1
    }

    /// Whether a kind is much heavier than another one.
    #[inline(always)]
    pub(crate) fn uneven(&self) -> bool {
        self.uneven
    }

    /// Numbers that controllers get.
    pub(crate) fn sensors(&self) -> usize {
        self.row.sensors.len()
    }

    /// Numbers that controllers give.
    pub(crate) fn actuators(&self) -> usize {
        self.row.actuators.len()
    }

    /// Those of them that are for the drive of a robot.
    #[inline(always)]
    pub(crate) fn drive(&self, index: usize) -> Range<usize> {
        let first = self.row.drives[self.group(index)];
        first..first + self.robot(index).drive.actuators().len()
    }

    /// Index of the first number for a robot's LEDs among the controllers' outputs.
    pub(crate) fn leds(&self, index: usize) -> usize {
        self.row.leds[self.group(index)]
    }

    /// Index of the number for grippers among the controllers' outputs; `None` if no kind has one.
    #[inline(always)]
    pub(crate) fn gripper(&self) -> Option<usize> {
        self.row.gripper
    }

    /// Whether any kind is such.
    pub(crate) fn any(&self, is: impl Fn(&Robot) -> bool) -> bool {
        self.groups.iter().any(|group| is(&group.robot))
    }

    /// Whether they come from a list of kinds.
    pub(crate) fn is_listed(&self) -> bool {
        self.groups.iter().any(|group| !group.name.is_empty())
    }

    /// Resolves the parts of a mission that the robots name; `at` is their path in error messages.
    ///
    /// # Errors
    /// The mission lacks something.
    pub(crate) fn settle(&mut self, layout: &Place, at: &str) -> Result<(), ParameterError> {
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

    /// Finds how far from a robot another one may hide a lamp from it.
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
            // Robots may be pressed into walls a little.
            sensors.shadow = 1.01 * shadows.fold(0.0, f32::max);
        }
    }

    /// Numbers of the longest message.
    #[inline(always)]
    pub(crate) fn message(&self) -> usize {
        self.row.message.len()
    }

    /// Index of the first number of messages among the controllers' outputs.
    pub(crate) fn message_at(&self) -> usize {
        self.row.message.start
    }

    /// Largest number of encoders.
    pub(crate) fn encoders(&self) -> usize {
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

    /// What controllers get, number by number; where kinds differ, all their names.
    pub(crate) fn sensor_names(&self) -> Vec<String> {
        self.row.sensors.clone()
    }

    /// What controllers give, in the same way.
    pub(crate) fn actuator_names(&self) -> Vec<String> {
        self.row.actuators.clone()
    }

    /// What a kind calls its own of them.
    pub(crate) fn own_names(&self, kind: usize) -> &Own {
        &self.row.own[kind]
    }
}
