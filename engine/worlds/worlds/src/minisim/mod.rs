//! Minisim: agents try to reach a goal before slower defenders catch them (D6.1, section 7.2.1).
//!
//! Arithmetic: every operation below is one IEEE 754 binary32 operation in the order written (square root
//! included), until the fitness, which is summed in binary64. Numbers in parameters are rounded from binary64.
//! cos_pi and sin_pi are those of `swarmwright_controllers::functions`. For a step, with `a` the actuator:
//!
//! 1. Every free agent, ascending: x = x + speedAgents * cos_pi(a), y = y + speedAgents * sin_pi(a), then each is
//!    limited to 0..=mapWidth and 0..=mapHeight.
//! 2. Every defender, ascending, looks at the free agents: dx = agent.x - x, dy = agent.y - y,
//!    q = dx*dx + dy*dy; the smallest q is the closest, the lower index on ties. d = sqrt(q). If d <= speedDefenders
//!    it goes to the agent's position, else f = speedDefenders / d, x = x + dx*f, y = y + dy*f.
//! 3. Every free agent with sqrt(dx*dx + dy*dy) <= goalRadius, dx = goal.x - x, dy = goal.y - y, has arrived.
//! 4. Of those still free, every one with sqrt(q) <= captureRadius, q its smallest as in 2 (dx = defender.x - x,
//!    dy = defender.y - y), is caught.
//!
//! With `steering: rule` agents steer themselves, and no actuators are asked for. In place of 1, for every free agent,
//! ascending: g = goal - agent, d = sqrt(g.x*g.x + g.y*g.y), w = (g.x / d, g.y / d), or 0, 0 where d is 0. With the closest
//! defender (as in the sensors) e = defender - agent, r = sqrt(e.x*e.x + e.y*e.y): if 0 < r < avoidanceRadius,
//! s = avoidance * (1 - r / avoidanceRadius), v = (-e.x, -e.y) for the evasion away, (-e.y, e.x) for left, (e.y, -e.x) for
//! right, w.x = w.x + s * (v.x / r), w.y = w.y + s * (v.y / r). Then n = sqrt(w.x*w.x + w.y*w.y), and unless it is 0
//! x = x + speedAgents * (w.x / n), y = y + speedAgents * (w.y / n), each limited as in 1.
//!
//! With `defenderSteering: controller` defenders are agents, too, numbered after the others, and sense what is closest to them:
//! (agent.x - x) / mapWidth, (agent.y - y) / mapHeight for the closest free agent as in 2, then the same for the goal. In place
//! of 2, every defender, ascending: x = x + speedDefenders * cos_pi(a), y = y + speedDefenders * sin_pi(a), limited as in 1.
//!
//! Sensors: (goal.x - x) / mapWidth, (goal.y - y) / mapHeight, then the same for the closest defender (smallest q,
//! lower index on ties), or 0, 0 without defenders.
//! Fitness: 0 - s / n, where s is the sum over agents, ascending, of the distance to the goal as in 3 (0 for those
//! arrived); s, the division and the subtraction in binary64. At the start all agents are free, wherever they stand.
//! Metrics: arrived and caught count agents, steps the steps that were made, distance is s / n.

mod lanes;
mod nearest;
mod points;
mod rule;
mod settings;

use crate::simulation::texts;
use crate::{
    Block, Body, Description, Determinism, Group, Means, MetricInfo, ParameterError, ParameterInfo,
    Parameters, RolloutError, Scene, Simulation,
};
pub(crate) use lanes::MinisimLanes;
use nearest::Nearest;
use points::{Point, squared_distance};
use settings::{MAX_BODIES, Settings};
use swarmwright_controllers::functions::{cos_pi, sin_pi};

/// In the order of `Simulation::metrics`.
const METRICS: &[MetricInfo] = &[
    MetricInfo::new("arrived", "agents", "Agents that have reached the goal."),
    MetricInfo::new("caught", "agents", "Agents that a defender has caught."),
    MetricInfo::new(
        "steps",
        "steps",
        "Steps until no agent was free, or maxSteps.",
    ),
    MetricInfo::new(
        "distance",
        "metres",
        "Mean distance of the agents to the goal at the end, 0 for those that have arrived.",
    ),
];
/// Index of `steps` in the above.
const STEPS: usize = 2;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Free,
    Arrived,
    Caught,
}

/// The simulation; see the module for its arithmetic.
#[derive(Debug, Clone)]
pub struct Minisim {
    settings: Settings,
    agents: Vec<Point>,
    states: Vec<State>,
    defenders: Vec<Point>,
    /// Free agents, ascending; none once the episode has ended.
    free: Vec<u32>,
    /// Those whose actuators are asked for: of agents and of defenders, what controllers steer.
    acting: Vec<u32>,
    /// Positions of the defenders, to find the closest one.
    near_defenders: Nearest,
    /// Positions of the free agents, while the defenders move.
    near_agents: Nearest,
    step: u32,
}

impl Default for Minisim {
    /// At the start of an episode of the published example.
    fn default() -> Self {
        Self::at_start(Settings::default())
    }
}

fn distance(from: Point, to: Point) -> f32 {
    squared_distance(from, to).sqrt()
}

fn limit(value: f32, high: f32) -> f32 {
    let value = if value < 0.0 { 0.0 } else { value };
    if value > high { high } else { value }
}

impl Minisim {
    fn at_start(settings: Settings) -> Self {
        let (agents, defenders) = (settings.agents.clone(), settings.defenders.clone());
        let free = (0..settings.count()).collect();
        let mut near_defenders = Nearest::default();
        near_defenders.fill(settings.map, defenders.iter().copied());
        let mut minisim = Self {
            states: vec![State::Free; agents.len()],
            settings,
            agents,
            defenders,
            free,
            acting: Vec::new(),
            near_defenders,
            near_agents: Nearest::default(),
            step: 0,
        };
        minisim.ask();
        minisim
    }

    /// Says whose actuators the next step needs.
    fn ask(&mut self) {
        self.acting.clear();
        if !self.settings.steers_itself {
            self.acting.extend_from_slice(&self.free);
        }
        if self.settings.controls_defenders {
            self.look_for_agents();
            if !self.free.is_empty() {
                let first = self.settings.count();
                self.acting.extend((first..).take(self.defenders.len()));
            }
        }
    }

    fn look_for_agents(&mut self) {
        let free = self.free.iter().map(|agent| self.agents[*agent as usize]);
        self.near_agents.fill(self.settings.map, free);
    }

    fn move_agents(&mut self, actuators: &[f32]) {
        let Settings {
            map, speed_agents, ..
        } = self.settings;
        for (agent, a) in self.free.iter().zip(actuators) {
            let [x, y] = &mut self.agents[*agent as usize];
            *x = limit(*x + speed_agents * cos_pi(*a), map[0]);
            *y = limit(*y + speed_agents * sin_pi(*a), map[1]);
        }
    }

    fn move_agents_by_rule(&mut self) {
        for agent in &self.free {
            let from = self.agents[*agent as usize];
            let nearest = self
                .near_defenders
                .closest(from)
                .map(|(position, _)| position);
            let [wx, wy] = self.settings.rule.way(from, self.settings.goal, nearest);
            let n = (wx * wx + wy * wy).sqrt();
            if n > 0.0 {
                let Settings {
                    map, speed_agents, ..
                } = self.settings;
                self.agents[*agent as usize] = [
                    limit(from[0] + speed_agents * (wx / n), map[0]),
                    limit(from[1] + speed_agents * (wy / n), map[1]),
                ];
            }
        }
    }

    fn move_defenders(&mut self) {
        let speed = self.settings.speed_defenders;
        self.look_for_agents();
        for defender in &mut self.defenders {
            let Some((target, q)) = self.near_agents.closest(*defender) else {
                return;
            };
            let d = q.sqrt();
            if d <= speed {
                *defender = target;
            } else {
                let f = speed / d;
                let (dx, dy) = (target[0] - defender[0], target[1] - defender[1]);
                *defender = [defender[0] + dx * f, defender[1] + dy * f];
            }
        }
        self.near_defenders
            .fill(self.settings.map, self.defenders.iter().copied());
    }

    fn steer_defenders(&mut self, actuators: &[f32]) {
        let Settings {
            map,
            speed_defenders,
            ..
        } = self.settings;
        for ([x, y], a) in self.defenders.iter_mut().zip(actuators) {
            *x = limit(*x + speed_defenders * cos_pi(*a), map[0]);
            *y = limit(*y + speed_defenders * sin_pi(*a), map[1]);
        }
        self.near_defenders
            .fill(map, self.defenders.iter().copied());
    }

    /// What a defender senses, if it is one.
    fn seen_by_defender(&self, agent: u32) -> Option<[f32; 4]> {
        let index = agent.checked_sub(self.settings.count())?;
        let [x, y] = *self.defenders.get(index as usize)?;
        let (target, _) = self.near_agents.closest([x, y])?;
        let ([width, height], goal) = (self.settings.map, self.settings.goal);
        Some([
            (target[0] - x) / width,
            (target[1] - y) / height,
            (goal[0] - x) / width,
            (goal[1] - y) / height,
        ])
    }

    fn judge_agents(&mut self) {
        for agent in &self.free {
            let agent = *agent as usize;
            let position = self.agents[agent];
            if distance(position, self.settings.goal) <= self.settings.goal_radius {
                self.states[agent] = State::Arrived;
            } else if let Some((_, q)) = self.near_defenders.closest(position)
                && q.sqrt() <= self.settings.capture_radius
            {
                self.states[agent] = State::Caught;
            }
        }
    }
}

impl Simulation for Minisim {
    fn description(&self) -> Description {
        Description {
            title: "minisim".to_owned(),
            dimensions: 2,
            max_agents: Some(MAX_BODIES),
            sensors: 4,
            actuators: 1,
            metrics: METRICS.into(),
            determinism: Determinism::Bitwise,
        }
    }

    fn parameters(&self) -> Vec<ParameterInfo> {
        settings::parameters()
    }

    fn sensor_names(&self) -> Vec<String> {
        texts(&["goal x", "goal y", "defender x", "defender y"])
    }

    fn groups(&self) -> Vec<Group> {
        if !self.settings.controls_defenders {
            return Vec::new();
        }
        let group = |name: &'static str, agents, sensor_names| Group {
            name: name.into(),
            agents,
            sensors: 4,
            actuators: 1,
            padded: false,
            sensor_names,
            actuator_names: self.actuator_names(),
            own_sensor_names: Vec::new(),
            own_actuator_names: Vec::new(),
        };
        let defenders = u32::try_from(self.defenders.len()).unwrap_or(u32::MAX);
        let names = texts(&["agent x", "agent y", "goal x", "goal y"]);
        let agents = group("agents", self.settings.count(), self.sensor_names());
        vec![agents, group("defenders", defenders, names)]
    }

    fn actuator_names(&self) -> Vec<String> {
        texts(&["heading"])
    }

    fn sensor_units(&self) -> Vec<String> {
        texts(&["map widths", "map heights", "map widths", "map heights"])
    }

    fn actuator_units(&self) -> Vec<String> {
        texts(&["half turns"])
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        *self = Self::at_start(Settings::read(parameters)?);
        Ok(())
    }

    fn acting(&self) -> &[u32] {
        &self.acting
    }

    fn done(&self) -> bool {
        self.free.is_empty()
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        let [width, height] = self.settings.map;
        let Some(&[x, y]) = self.agents.get(agent as usize) else {
            if let Some(inputs) = self.seen_by_defender(agent) {
                sensors.copy_from_slice(&inputs);
            }
            return;
        };
        let goal = self.settings.goal;
        let to_goal = [(goal[0] - x) / width, (goal[1] - y) / height];
        let to_defender = self
            .near_defenders
            .closest([x, y])
            .map_or([0.0; 2], |(defender, _)| {
                [(defender[0] - x) / width, (defender[1] - y) / height]
            });
        for (sensor, value) in sensors
            .iter_mut()
            .zip(to_goal.into_iter().chain(to_defender))
        {
            *sensor = value;
        }
    }

    fn step(&mut self, actuators: &[f32]) {
        if self.free.is_empty() {
            return;
        }
        let steered = if self.settings.steers_itself {
            self.move_agents_by_rule();
            0
        } else {
            self.move_agents(actuators);
            self.free.len()
        };
        if self.settings.controls_defenders {
            self.steer_defenders(actuators.get(steered..).unwrap_or_default());
        } else {
            self.move_defenders();
        }
        self.judge_agents();
        self.step += 1;
        if self.step >= self.settings.max_steps {
            self.free.clear();
        }
        self.free
            .retain(|agent| self.states[*agent as usize] == State::Free);
        self.ask();
    }

    fn fitness(&self) -> f64 {
        let mut sum = 0.0_f64;
        for (position, state) in self.agents.iter().zip(&self.states) {
            if *state != State::Arrived {
                sum += f64::from(distance(*position, self.settings.goal));
            }
        }
        0.0 - sum / f64::from(self.settings.count())
    }

    fn metrics(&self) -> Vec<f64> {
        let count = |target| {
            let agents = self.states.iter().filter(|state| **state == target);
            agents.count() as f64
        };
        vec![
            count(State::Arrived),
            count(State::Caught),
            f64::from(self.step),
            0.0 - self.fitness(),
        ]
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        Some(Box::new(self.clone()))
    }

    fn evaluate(
        &mut self,
        block: &Block<'_>,
        means: Means,
    ) -> Option<Result<Vec<f64>, RolloutError>> {
        crate::evaluate("minisim", block, means)
    }

    fn has_scenes(&self) -> bool {
        true
    }

    fn scene(&self) -> Option<Scene> {
        let Settings {
            map,
            goal,
            goal_radius,
            capture_radius,
            ..
        } = self.settings;
        let body = |kind: &'static str, position: Point, state: &'static str, radius| Body {
            kind: kind.into(),
            x: position[0],
            y: position[1],
            state: state.into(),
            radius,
            ..Body::default()
        };
        let defenders = self
            .defenders
            .iter()
            .map(|d| body("defender", *d, "", capture_radius));
        let agents = self
            .agents
            .iter()
            .zip(&self.states)
            .map(|(position, state)| {
                let state = match state {
                    State::Free => "free",
                    State::Arrived => "arrived",
                    State::Caught => "caught",
                };
                body("agent", *position, state, 0.0)
            });
        Some(Scene {
            width: map[0],
            height: map[1],
            grid: false,
            step: self.step,
            message: self.settings.hello_message.clone(),
            bodies: std::iter::once(body("goal", goal, "", goal_radius))
                .chain(defenders)
                .chain(agents)
                .collect(),
            ..Scene::default()
        })
    }

    fn step_size(&self) -> u64 {
        u64::from(self.settings.step_size)
    }
}
