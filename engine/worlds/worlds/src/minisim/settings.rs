//! Parameters of Minisim: names, defaults, ranges.

use super::Point;
use super::rule::{Evasion, Rule};
use crate::counter::uniform;
use crate::parameters::wrong;
use crate::{ParameterError, ParameterInfo, ParameterReader, Parameters};
use serde_json::{Value, json};

/// Of an episode: a server is to be free again some time.
const MAX_STEPS: u32 = 10_000_000;

/// Most agents, and most defenders.
pub(super) const MAX_BODIES: u32 = 100_000;
/// Far below 2^24, so that every whole number is a binary32.
const MAX_EXTENT: u32 = 1_000_000;
const MAX_STEP_SIZE: u32 = 3_600_000;
const AGENT_STREAM: u64 = 0;
const DEFENDER_STREAM: u64 = 1;

/// Checked parameters, with the positions at the start.
#[derive(Debug, Clone)]
pub(super) struct Settings {
    pub map: Point,
    pub speed_agents: f32,
    pub speed_defenders: f32,
    pub agents: Vec<Point>,
    pub defenders: Vec<Point>,
    pub goal: Point,
    pub hello_message: String,
    pub step_size: u32,
    pub max_steps: u32,
    pub capture_radius: f32,
    pub goal_radius: f32,
    /// Whether agents follow the rule and no actuators are asked for.
    pub steers_itself: bool,
    /// Whether actuators are asked for defenders, too.
    pub controls_defenders: bool,
    pub rule: Rule,
}

impl Default for Settings {
    /// The published example (D6.1, Schema 10).
    fn default() -> Self {
        Self {
            map: [13.0, 7.0],
            speed_agents: 1.0,
            speed_defenders: 0.33,
            agents: vec![[0.5, 3.5]],
            defenders: vec![[8.0, 3.5]],
            goal: [12.5, 3.5],
            hello_message: "Welcome to minisim".to_owned(),
            step_size: 250,
            max_steps: 15,
            capture_radius: 0.5,
            goal_radius: 0.5,
            steers_itself: false,
            controls_defenders: false,
            rule: Rule {
                avoidance: 1.0,
                radius: 2.0,
                evasion: Evasion::Away,
            },
        }
    }
}

/// What stands where a kind of body is not listed.
enum Placement {
    Fixed,
    Random { seed: u64 },
}

impl Settings {
    /// Number of agents.
    pub(super) fn count(&self) -> u32 {
        u32::try_from(self.agents.len()).unwrap_or(u32::MAX)
    }

    pub(super) fn read(parameters: &Parameters) -> Result<Self, ParameterError> {
        let read = ParameterReader::new(parameters);
        let default = Self::default();
        let extent = |name, default| {
            // Whole numbers of this size are exact in binary32.
            Ok::<f32, ParameterError>(
                read.integer(name, 1, MAX_EXTENT)?
                    .map_or(default, |n| n as f32),
            )
        };
        let map = [
            extent("mapWidth", default.map[0])?,
            extent("mapHeight", default.map[1])?,
        ];
        let seed = read.seed("seed")?.unwrap_or(0);
        let placement = match read.choice("placement", &["fixed", "random"])? {
            Some(1) => Placement::Random { seed },
            _ => Placement::Fixed,
        };
        let agents = listed(read, "agents", "numAgents", 1, map)?;
        let agents =
            agents.unwrap_or_else(|n| (0..n).map(|i| agent_start(&placement, i, n, map)).collect());
        let defenders = listed(read, "defenders", "numDefenders", 0, map)?;
        let defenders = defenders.unwrap_or_else(|n| {
            (0..n)
                .map(|i| defender_start(&placement, i, n, map))
                .collect()
        });
        Ok(Self {
            map,
            speed_agents: read
                .not_negative("speedAgents")?
                .unwrap_or(default.speed_agents),
            speed_defenders: read
                .not_negative("speedDefenders")?
                .unwrap_or(default.speed_defenders),
            agents,
            defenders,
            goal: read
                .position("goal", map)?
                .unwrap_or([map[0] - 0.5, map[1] / 2.0]),
            hello_message: read
                .text("helloMessage")?
                .map_or(default.hello_message, str::to_owned),
            step_size: read
                .integer("stepSize", 0, MAX_STEP_SIZE)?
                .unwrap_or(default.step_size),
            max_steps: read
                .integer("maxSteps", 1, MAX_STEPS)?
                .unwrap_or(default.max_steps),
            capture_radius: read
                .not_negative("captureRadius")?
                .unwrap_or(default.capture_radius),
            goal_radius: read
                .not_negative("goalRadius")?
                .unwrap_or(default.goal_radius),
            steers_itself: read.choice("steering", &["controller", "rule"])? == Some(1),
            controls_defenders: read.choice("defenderSteering", &["rule", "controller"])?
                == Some(1),
            rule: rule(read, default.rule)?,
        })
    }
}

fn rule(read: ParameterReader<'_>, default: Rule) -> Result<Rule, ParameterError> {
    Ok(Rule {
        avoidance: read.not_negative("avoidance")?.unwrap_or(default.avoidance),
        radius: read
            .not_negative("avoidanceRadius")?
            .unwrap_or(default.radius),
        evasion: match read.choice("evasion", &["away", "left", "right"])? {
            Some(1) => Evasion::Left,
            Some(2) => Evasion::Right,
            _ => default.evasion,
        },
    })
}

/// The positions that are listed, or else how many bodies (1 by default) are to be placed.
fn listed(
    read: ParameterReader<'_>,
    list: &str,
    number: &str,
    least: u32,
    map: Point,
) -> Result<Result<Vec<Point>, u32>, ParameterError> {
    let count = read.integer(number, least, MAX_BODIES)?;
    let Some(positions) = read.positions(list, MAX_BODIES, map)? else {
        return Ok(Err(count.unwrap_or(1)));
    };
    let length = positions.len();
    if length < least as usize {
        return Err(wrong(
            list,
            "an empty list found, expected at least one position [x, y]",
        ));
    }
    match count {
        Some(count) if count as usize != length => Err(wrong(
            list,
            format!(
                "{length} positions found, but {number} is {count}; make them agree or leave one out"
            ),
        )),
        _ => Ok(Ok(positions)),
    }
}

/// Evenly from bottom to top: (i + 1) * mapHeight / (n + 1).
fn spread(i: u32, n: u32, map: Point) -> f32 {
    (i + 1) as f32 * map[1] / (n + 1) as f32
}

/// Two uniform numbers for one body: draws 2i and 2i + 1 of its stream.
fn pair(seed: u64, stream: u64, i: u32) -> Point {
    let index = 2 * u64::from(i);
    [
        uniform(seed, stream, index),
        uniform(seed, stream, index + 1),
    ]
}

/// Fixed: x = 0.5. Random: x = u * (mapWidth / 3), y = v * mapHeight.
fn agent_start(placement: &Placement, i: u32, n: u32, map: Point) -> Point {
    match placement {
        Placement::Fixed => [0.5, spread(i, n, map)],
        Placement::Random { seed } => {
            let [u, v] = pair(*seed, AGENT_STREAM, i);
            [u * (map[0] / 3.0), v * map[1]]
        }
    }
}

/// Fixed: x = mapWidth * 8 / 13. Random: x = mapWidth / 3 + u * (mapWidth / 3), y = v * mapHeight.
fn defender_start(placement: &Placement, i: u32, n: u32, map: Point) -> Point {
    match placement {
        Placement::Fixed => [map[0] * 8.0 / 13.0, spread(i, n, map)],
        Placement::Random { seed } => {
            let [u, v] = pair(*seed, DEFENDER_STREAM, i);
            let third = map[0] / 3.0;
            [third + u * third, v * map[1]]
        }
    }
}

/// Every parameter, in the order of the documentation.
pub(super) fn parameters() -> Vec<ParameterInfo> {
    let d = Settings::default();
    // Binary32 defaults as the decimals people write: 0.33, not 0.33000001.
    let short = |n: f32| {
        n.to_string()
            .parse::<f64>()
            .map_or(Value::Null, Value::from)
    };
    let info = |name, kind, default, description| ParameterInfo {
        name,
        kind,
        default,
        description,
    };
    vec![
        info(
            "mapWidth",
            "integer",
            json!(13),
            "Width of the map, metres, 1 to 1000000.",
        ),
        info(
            "mapHeight",
            "integer",
            json!(7),
            "Height of the map, metres, 1 to 1000000.",
        ),
        info(
            "numAgents",
            "integer",
            json!(1),
            "Number of agents, 1 to 100000; the length of agents where that is given.",
        ),
        info(
            "numDefenders",
            "integer",
            json!(1),
            "Number of defenders, 0 to 100000; the length of defenders where that is given.",
        ),
        info(
            "speedAgents",
            "number",
            short(d.speed_agents),
            "Way of an agent in a step, metres, at least 0.",
        ),
        info(
            "speedDefenders",
            "number",
            short(d.speed_defenders),
            "Longest way of a defender in a step, metres, at least 0.",
        ),
        info(
            "agents",
            "positions",
            Value::Null,
            "Start of each agent; left out: as placement says (fixed: x = 0.5, evenly from bottom to top).",
        ),
        info(
            "defenders",
            "positions",
            Value::Null,
            "Start of each defender; left out: as placement says (fixed: x = mapWidth * 8 / 13, evenly from bottom to top).",
        ),
        info(
            "goal",
            "position",
            Value::Null,
            "The goal; left out: [mapWidth - 0.5, mapHeight / 2].",
        ),
        info(
            "helloMessage",
            "string",
            json!(d.hello_message),
            "A line shown above the map.",
        ),
        info(
            "stepSize",
            "integer",
            json!(d.step_size),
            "Milliseconds between two frames when shown, 0 to 3600000.",
        ),
        info(
            "maxSteps",
            "integer",
            json!(d.max_steps),
            "Steps after which the episode ends, 1 to 10000000.",
        ),
        info(
            "captureRadius",
            "number",
            short(d.capture_radius),
            "Distance to a defender within which an agent is caught, metres, at least 0.",
        ),
        info(
            "goalRadius",
            "number",
            short(d.goal_radius),
            "Distance to the goal within which an agent has arrived, metres, at least 0.",
        ),
        info(
            "placement",
            "string",
            json!("fixed"),
            "Where agents and defenders without a list start: fixed, or random by seed (agents in the left third, defenders in the middle third).",
        ),
        info(
            "steering",
            "string",
            json!("controller"),
            "Who steers the agents: controller, or rule: they steer themselves, to the goal and around the closest defender.",
        ),
        info(
            "defenderSteering",
            "string",
            json!("rule"),
            "Who steers the defenders: rule: they go to the closest free agent; or controller: they are agents, numbered after the others, which sense the closest free agent and the goal; the groups of a controller of the kind team are then agents and defenders.",
        ),
        info(
            "avoidance",
            "number",
            short(d.rule.avoidance),
            "With steering: rule, the weight of evading a defender at distance 0, where that of the goal is 1; at least 0. It falls with the distance to 0 at avoidanceRadius.",
        ),
        info(
            "avoidanceRadius",
            "number",
            short(d.rule.radius),
            "With the rule: the distance from which on a defender is evaded, metres, at least 0.",
        ),
        info(
            "evasion",
            "string",
            json!("away"),
            "With the rule: the way around a defender that is straight ahead: away from it, to its left or to its right, seen with y pointing up.",
        ),
        info(
            "seed",
            "integer",
            json!(0),
            "Seed of random placement; in experiments 0 to 2^62.",
        ),
    ]
}
