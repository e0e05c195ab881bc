//! Parameters of the arena.

use serde_json::{Value, json};
use swarmwright_simulation::parameters::wrong;
use swarmwright_simulation::{ParameterError, ParameterInfo, ParameterReader, Parameters};

use crate::failures::{self, Failure};
use crate::missions::{self, Mission};
use crate::mistakes::{Mistakes, with_place};
use crate::place::Start;
use crate::robots::{Group, Team};
use crate::start::{Starts, objects, robots as start};
use crate::time::LONGEST;

/// Checked parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The mission.
    pub mission: Mission,
    /// The robots.
    pub team: Team,
    /// Name of the parameter that sets the number of robots.
    counted: &'static str,
    /// Failures of robots.
    pub failures: Vec<Failure>,
    /// The start region of each kind of robots.
    regions: Vec<Start>,
    /// Ticks of 0.1 s; the first one is the start.
    pub ticks: u32,
    /// Seed of the episode.
    pub seed: u64,
    /// Milliseconds per step, for tools that show episodes.
    pub step_size: u32,
}

impl Settings {
    /// Reads parameters.
    ///
    /// # Errors
    /// Returns the first invalid parameter.
    pub fn read(parameters: &Parameters) -> Result<Self, ParameterError> {
        Self::read_all(parameters).map_err(Mistakes::into_first)
    }

    /// Reads parameters.
    ///
    /// # Errors
    /// Returns all invalid parameters, those of the mission first. Checks that need the mission are skipped if it is
    /// invalid.
    pub fn read_all(parameters: &Parameters) -> Result<Self, Mistakes> {
        let read = ParameterReader::new(parameters);
        let mut mistakes = Mistakes::default();
        let mission = mistakes.take(Mission::read(parameters.get("mission")));
        let duration = mistakes.take(read.number("duration", 0.1, LONGEST));
        let seed = mistakes.take(read.seed("seed"));
        let step_size = mistakes.take(read.integer("stepSize", 0, 3_600_000));
        let (robots, robot) = (parameters.get("robots"), parameters.get("robot"));
        let failures = parameters.get("failures");
        let failures = failures.map(|value| failures::read(value, "failures"));
        let failures = mistakes.take(failures.transpose());
        let Some(mission) = mission else {
            // Check against the robots of any mission, so that mistakes in the robots themselves are reported.
            let any = Team::of_mission(None, None)?;
            mistakes.take(any.but(robots, robot));
            return Err(mistakes);
        };
        let team = mistakes.take(Self::team(&mission, robots, robot));
        let (Some(duration), Some(failures), Some(team)) = (duration, failures, team) else {
            return Err(mistakes);
        };
        let ticks = (duration.unwrap_or(mission.duration) * 10.0).round() as u32;
        let path = failures.as_ref().map_or("mission.failures", |_| "failures");
        let failures = failures.unwrap_or_else(|| mission.failures.clone());
        for (index, failure) in failures.iter().enumerate() {
            let at = format!("{path}[{index}]");
            mistakes.take(Self::check_failure(failure, &at, &team, ticks));
        }
        Self::check_names(&mission, &team, &mut mistakes);
        for (name, metric) in &mission.metrics {
            let at = format!("mission.metrics.{name}");
            let time = metric.check_time(ticks);
            mistakes.take(time.map_err(|error| with_place(&at, error)));
        }
        let regions = mistakes.take(Self::regions(&mission, &team, robots));
        let counted = if robots.is_some() {
            "robots"
        } else {
            "mission.robots"
        };
        let rest = seed.zip(step_size).zip(regions);
        mistakes.or(rest.map(|((seed, step_size), regions)| Self {
            team,
            regions,
            counted,
            failures,
            ticks,
            seed: seed.unwrap_or(0),
            step_size: step_size.unwrap_or(100),
            mission,
        }))
    }

    /// Returns the robots of the mission, as changed by the parameters.
    fn team(
        mission: &Mission,
        robots: Option<&Value>,
        robot: Option<&Value>,
    ) -> Result<Team, Mistakes> {
        let mut team = mission.team.but(robots, robot)?;
        let at = match (robots, robot) {
            (Some(Value::Array(_)), _) => "robots",
            (_, Some(_)) => "robot",
            _ if mission.team.is_listed() => "mission.robots",
            _ => "mission.robot",
        };
        team.settle(&mission.place, at)?;
        Ok(team)
    }

    /// Checks that the kinds of robots exist that metrics, rules and sides of the mission name.
    fn check_names(mission: &Mission, team: &Team, mistakes: &mut Mistakes) {
        for (metric, kind) in &mission.metrics {
            if let Some(name) = kind.robots() {
                mistakes.take(team.check(name, &format!("mission.metrics.{metric}.robots")));
            }
        }
        for (index, capture) in mission.rules.captures.iter().enumerate() {
            for (field, name) in [("robots", &capture.robots), ("by", &capture.by)] {
                let at = format!("mission.captures[{index}].{field}");
                mistakes.take(team.check(name, &at));
            }
        }
        for (index, flag) in mission.rules.flags.iter().enumerate() {
            for (field, name) in [("robots", &flag.robots), ("lost_to", &flag.lost_to)] {
                let at = format!("mission.flags[{index}].{field}");
                mistakes.take(team.check(name, &at));
            }
        }
        for side in &mission.sides {
            for name in &side.groups {
                mistakes.take(team.check(name, &format!("mission.sides.{}", side.name)));
            }
        }
    }

    /// Returns the start region of each kind of robots: its own, or that of the mission. `robots` is the parameter.
    fn regions(
        mission: &Mission,
        team: &Team,
        robots: Option<&Value>,
    ) -> Result<Vec<Start>, ParameterError> {
        let path = match robots {
            Some(Value::Array(_)) => "robots",
            _ => "mission.robots",
        };
        let groups = team.groups().iter().enumerate();
        let region = |(index, group): (usize, &Group)| match &group.start {
            None => Ok(mission.start.clone()),
            Some(value) => {
                missions::region(&format!("{path}[{index}].start"), value, &mission.place)
            }
        };
        groups.map(region).collect()
    }

    /// Checks that a failure can affect robots of the team.
    fn check_failure(
        failure: &Failure,
        at: &str,
        team: &Team,
        ticks: u32,
    ) -> Result<(), ParameterError> {
        if let Some(name) = failure.robots() {
            team.check(name, &format!("{at}.robots"))?;
        }
        failure
            .check_effect(ticks, team.count(failure.robots()))
            .map_err(|(name, reason)| wrong(&format!("{at}.{name}"), reason))
    }
}

impl Settings {
    /// Draws the start positions of robots and objects.
    pub fn starts(&self) -> Result<Starts, ParameterError> {
        let (mission, robots) = (&self.mission, self.team.len());
        let layout = &mission.place;
        let objects = objects::draw(&layout.objects, layout, self.seed).map_err(|(kind, count)| {
            wrong(
                &format!("mission.objects[{kind}]"),
                format!(
                    "{} objects do not fit into their start region: only {count} found a free position at random; use fewer, or \
                     a larger start or arena",
                    layout.objects[kind].count()
                ),
            )
        })?;
        let forms = layout.forms().zip(objects.iter().copied());
        let poses = start::draw(
            &self.regions,
            &self.team,
            (layout, &forms.collect::<Vec<_>>()),
            self.seed,
        );
        let robots = poses.map_err(|count| {
            wrong(
                self.counted,
                format!(
                    "{robots} robots do not fit into their start region: only {count} found a free position at random; use \
                     fewer, or a larger start or arena"
                ),
            )
        })?;
        Ok(Starts { robots, objects })
    }
}

/// Returns every parameter, in the order of the documentation.
pub fn parameters() -> Vec<ParameterInfo> {
    [
        (
            "mission",
            "name or object",
            json!("aac"),
            "The name of a built-in mission (see the page on the arena), or a mission as an object; in an experiment file also \
             the path of a YAML file.",
        ),
        (
            "robots",
            "integer or objects",
            Value::Null,
            "Number of robots, 1 to 100,000, or a list of kinds {robot, count, name} for robots of several models; left out: \
             what the mission says.",
        ),
        (
            "duration",
            "number",
            Value::Null,
            "Length of an episode in seconds, 0.1 to 26214.3, in ticks of 0.1 s; left out: what the mission says.",
        ),
        (
            "robot",
            "name or object",
            Value::Null,
            "Model of the robots: e-puck-rm1.1 (the inputs of EvoStick), e-puck-rm1.2 (those of Chocolate's modules), \
             foot-bot, kilobot, turtlebot3 or point, or a robot as an object, which may name one of these as its preset; in \
             an experiment file also the path of a YAML file; left out: what the mission says.",
        ),
        (
            "failures",
            "objects",
            Value::Null,
            "Robots that fail: a list of at most 16 {kind: stop, slow, blind or mute, share, robots, at, until}, slow with a factor, and {kind: \
             loss, loss, at, until}; left out: what the mission says.",
        ),
        (
            "seed",
            "integer",
            json!(0),
            "Decides where robots start, and all noise.",
        ),
        (
            "stepSize",
            "integer",
            json!(100),
            "Milliseconds between two frames when shown, 0 to 3600000.",
        ),
    ]
    .into_iter()
    .map(|(name, kind, default, description)| ParameterInfo {
        name,
        kind,
        default,
        description,
    })
    .collect()
}
