//! Emergency Exit: agents on a grid look for the nearest exit and stand in each other's way (FREVO's problem of that
//! name, by Thomas Dittrich).
//!
//! Arithmetic. Positions are cells, [0, 0] top-left, x to the right, y down. For an agent in turn:
//!
//! 1. Sensors, each a whole number in binary32: dx, dy to the nearest exit (smallest dx*dx + dy*dy, the first in the
//!    list on ties), then for N, NE, E, SE, S, SW, W, NW (N is y - 1) 1 where that cell is free, else 0. Free is what
//!    is inside, no blockade, and without an agent that is not out. Exits are free like any other cell.
//! 2. Actuators a, b give the move (v(a), v(b)): v(a) = 1 if a >= 0.5, -1 if a < -0.5, else 0. That is floor(a + 0.5)
//!    without rounding, which is Java's Math.round.
//! 3. If the move is one of the eight and that cell was free, the agent goes there.
//! 4. If the agent now stands on an exit, moved or not, it is out: it acts no more and occupies nothing.
//!
//! Sequential update: agents act in index order, each sensing the moves already made; a step ends when all who were
//! not out have acted. Simultaneous update: all sense the same moment; then moves are made in index order, where a
//! cell that an agent stood on at that moment is not free, and neither is one that a lower index took in this step.
//!
//! The episode ends when all are out or at `steps`. Fitness: f = (steps - finished) / steps, then f = f - d for each
//! agent, ascending, d = sqrt(dx*dx + dy*dy) to the nearest exit, all in binary64; `finished` is the step, from 0,
//! during which the last agent got out, else `steps`. Agents that start on an exit are not out before they have acted.
//! Metrics: out counts agents, finished is that step, distance is 0 + d + d ... over the agents, ascending.

mod field;
mod grid;
mod lanes;
mod nearest;
mod random;
mod settings;

use crate::simulation::texts;
use crate::{
    Block, Body, Description, Determinism, Means, MetricInfo, ParameterError, ParameterInfo,
    Parameters, RolloutError, Scene, Simulation,
};
use field::{Cell, Field, RandomField};
use grid::{DIRECTION_OF_MOVE, Grid, Taken};
pub(crate) use lanes::EmergencyExitLanes;
use settings::{MAX_AGENTS, Plan, Settings, Update};

const SENSORS: usize = 10;
const ACTUATORS: usize = 2;
/// In the order of `Simulation::metrics`.
const METRICS: &[MetricInfo] = &[
    MetricInfo::new("out", "agents", "Agents that have left by an exit."),
    MetricInfo::new(
        "finished",
        "steps",
        "The step, from 0, during which the last agent got out; the parameter steps if not all did.",
    ),
    MetricInfo::new(
        "distance",
        "cells",
        "Sum over the agents of the distance to the nearest exit at the end.",
    ),
];

/// The simulation; see the module for its arithmetic.
#[derive(Debug, Clone)]
pub struct EmergencyExit {
    settings: Settings,
    /// Origin of the field, since many episodes in succession use the same one.
    plan: Plan,
    field: Field,
    grid: Grid,
    /// By agent: the index of its cell.
    places: Vec<usize>,
    out: Vec<bool>,
    /// By cell: whether an agent that is not out stands there.
    occupied: Taken,
    /// Agents that were not out when this step began, ascending.
    inside: Vec<u32>,
    /// How many of them have acted.
    turn: usize,
    acting: Vec<u32>,
    /// Cells left in this simultaneous step.
    left: Vec<usize>,
    step: u32,
    finished: Option<u32>,
}

impl Default for EmergencyExit {
    /// At the start of an episode on FREVO's random field of seed 0.
    fn default() -> Self {
        let random = RandomField {
            width: 20,
            height: 20,
            agents: 10,
            exits: 5,
            blockades: 20,
            seed: 0,
        };
        let settings = Settings {
            steps: 50,
            step_size: 200,
            update: Update::Sequential,
        };
        let field = Field::random(random);
        let mut simulation = Self {
            settings,
            plan: Plan::Random(random),
            grid: Grid::new(&field),
            field,
            places: Vec::new(),
            out: Vec::new(),
            occupied: Taken::default(),
            inside: Vec::new(),
            turn: 0,
            acting: Vec::new(),
            left: Vec::new(),
            step: 0,
            finished: None,
        };
        simulation.start();
        simulation
    }
}

/// -1, 0 or 1.
#[inline]
fn velocity(actuator: f32) -> i8 {
    i8::from(actuator >= 0.5) - i8::from(actuator < -0.5)
}

/// The direction of a move, if any.
#[inline]
fn direction(row: &[f32]) -> Option<usize> {
    let &[a, b] = row else { return None };
    let index = (velocity(b) + 1) * 3 + velocity(a) + 1;
    let direction = DIRECTION_OF_MOVE[index as usize];
    (direction < 8).then_some(direction)
}

impl EmergencyExit {
    /// Puts the agents where the field says.
    fn start(&mut self) {
        self.places.clear();
        let places = self.field.agents.iter().map(|cell| self.grid.index(*cell));
        self.places.extend(places);
        self.out.clear();
        self.out.resize(self.places.len(), false);
        self.occupied.clear(self.grid.len());
        for position in &self.places {
            self.occupied.take(*position);
        }
        self.inside.clear();
        self.inside.extend(0..self.places.len() as u32);
        self.step = 0;
        self.finished = None;
        self.begin_step();
    }

    fn begin_step(&mut self) {
        self.turn = 0;
        self.acting.clear();
        if self.step < self.settings.steps {
            match self.settings.update {
                Update::Sequential => self.acting.extend(self.inside.first()),
                Update::Simultaneous => self.acting.extend_from_slice(&self.inside),
            }
        }
    }

    fn end_step(&mut self) {
        self.inside.retain(|agent| !self.out[*agent as usize]);
        if self.inside.is_empty() {
            self.finished = Some(self.step);
        }
        self.step += 1;
        self.begin_step();
    }

    /// The free cell that an agent's actuators lead to.
    fn target(&self, agent: usize, row: &[f32]) -> Option<usize> {
        self.grid
            .neighbour(self.places[agent], direction(row)?)
            .filter(|cell| !self.occupied.holds(*cell))
    }

    /// Whether the agent stands on an exit; then it is out.
    fn leaves(&mut self, agent: usize) -> bool {
        self.out[agent] = self.grid.to_exit(self.places[agent]) == [0, 0];
        self.out[agent]
    }

    fn act(&mut self, agent: usize, row: &[f32]) {
        if let Some(cell) = self.target(agent, row) {
            self.occupied.free(self.places[agent]);
            self.occupied.take(cell);
            self.places[agent] = cell;
        }
        if self.leaves(agent) {
            self.occupied.free(self.places[agent]);
        }
    }

    fn act_all(&mut self, actuators: &[f32]) {
        self.left.clear();
        for (turn, row) in (0..self.inside.len()).zip(actuators.chunks_exact(ACTUATORS)) {
            let agent = self.inside[turn] as usize;
            if let Some(cell) = self.target(agent, row) {
                // Cells stay taken to the end of the step: what was not free when all sensed is free for no agent.
                self.left.push(self.places[agent]);
                self.occupied.take(cell);
                self.places[agent] = cell;
            }
            if self.leaves(agent) {
                self.left.push(self.places[agent]);
            }
        }
        for cell in &self.left {
            self.occupied.free(*cell);
        }
    }
}

impl Simulation for EmergencyExit {
    fn description(&self) -> Description {
        Description {
            title: "emergency_exit".to_owned(),
            dimensions: 2,
            max_agents: Some(MAX_AGENTS),
            sensors: SENSORS,
            actuators: ACTUATORS,
            metrics: METRICS.into(),
            determinism: Determinism::Bitwise,
        }
    }

    fn parameters(&self) -> Vec<ParameterInfo> {
        settings::parameters()
    }

    fn sensor_names(&self) -> Vec<String> {
        texts(&[
            "exit x", "exit y", "N free", "NE free", "E free", "SE free", "S free", "SW free",
            "W free", "NW free",
        ])
    }

    fn actuator_names(&self) -> Vec<String> {
        texts(&["move x", "move y"])
    }

    fn sensor_units(&self) -> Vec<String> {
        texts(&["cells", "cells", "", "", "", "", "", "", "", ""])
    }

    fn actuator_units(&self) -> Vec<String> {
        texts(&["cells", "cells"])
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        let settings = Settings::read(parameters)?;
        let previous = Some((&self.plan, &self.field));
        if let Some((plan, field)) = settings::read_field(parameters, previous)? {
            self.grid = Grid::new(&field);
            self.field = field;
            self.plan = plan;
        }
        self.settings = settings;
        self.start();
        Ok(())
    }

    fn acting(&self) -> &[u32] {
        &self.acting
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        let (Some(&position), [dx, dy, neighbours @ ..]) =
            (self.places.get(agent as usize), sensors)
        else {
            return;
        };
        [*dx, *dy] = self.grid.to_exit(position).map(f32::from);
        for (d, sensor) in neighbours.iter_mut().enumerate().take(8) {
            let free = self
                .grid
                .neighbour(position, d)
                .is_some_and(|cell| !self.occupied.holds(cell));
            *sensor = f32::from(u8::from(free));
        }
    }

    fn step(&mut self, actuators: &[f32]) {
        let Some(&agent) = self.acting.first() else {
            return;
        };
        match self.settings.update {
            Update::Sequential => {
                self.act(agent as usize, actuators);
                self.turn += 1;
                if let Some(next) = self.inside.get(self.turn) {
                    self.acting[0] = *next;
                } else {
                    self.end_step();
                }
            }
            Update::Simultaneous => {
                self.act_all(actuators);
                self.end_step();
            }
        }
    }

    fn mid_step(&self) -> bool {
        self.turn > 0
    }

    fn fitness(&self) -> f64 {
        let steps = self.settings.steps;
        let finished = self.finished.unwrap_or(steps);
        let mut fitness = f64::from(steps - finished) / f64::from(steps);
        for position in &self.places {
            fitness -= self.grid.distance(*position);
        }
        fitness
    }

    fn metrics(&self) -> Vec<f64> {
        let out = self.out.iter().filter(|out| **out).count();
        let mut distance = 0.0;
        for position in &self.places {
            distance += self.grid.distance(*position);
        }
        let finished = self.finished.unwrap_or(self.settings.steps);
        vec![out as f64, f64::from(finished), distance]
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        Some(Box::new(self.clone()))
    }

    fn evaluate(
        &mut self,
        block: &Block<'_>,
        means: Means,
    ) -> Option<Result<Vec<f64>, RolloutError>> {
        crate::evaluate("emergency_exit", block, means)
    }

    fn has_scenes(&self) -> bool {
        true
    }

    fn scene(&self) -> Option<Scene> {
        // Scenes have y pointing up.
        let top = self.field.rows as f32;
        let body = |kind: &'static str, [x, y]: Cell, state: &'static str| Body {
            kind: kind.into(),
            x: x as f32 + 0.5,
            y: top - y as f32 - 0.5,
            state: state.into(),
            radius: 0.0,
            ..Body::default()
        };
        let agents = self.places.iter().zip(&self.out).map(|(position, out)| {
            let state = if *out { "out" } else { "free" };
            body("agent", self.grid.cell(*position), state)
        });
        let blockades = self
            .field
            .blockades
            .iter()
            .map(|c| body("blockade", *c, ""));
        let exits = self.field.exits.iter().map(|c| body("exit", *c, ""));
        Some(Scene {
            width: self.field.width as f32,
            height: top,
            grid: true,
            step: self.step,
            message: "Emergency Exit".to_owned(),
            bodies: blockades.chain(exits).chain(agents).collect(),
            ..Scene::default()
        })
    }

    fn step_size(&self) -> u64 {
        u64::from(self.settings.step_size)
    }
}
