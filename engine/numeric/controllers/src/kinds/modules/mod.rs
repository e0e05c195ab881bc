//! Probabilistic finite-state machines, and behaviour trees, of given behaviours and conditions.

mod behaviours;
mod conditions;
mod lanes;
mod random;

use super::Kind;
use crate::SpecificationError;
use crate::reader::Reader;
use conditions::probability;
use random::Random;
use serde::Serialize;

/// Names of modules, in the order of their numbers.
macro_rules! names {
    ($modules:expr) => {{
        let mut names = [""; $modules.len()];
        let mut index = 0;
        while index < names.len() {
            names[index] = $modules[index].name;
            index += 1;
        }
        names
    }};
}
use names;

/// Names of the behaviours, in the order of their numbers.
pub const BEHAVIOUR_NAMES: [&str; behaviours::COUNT] = behaviours::NAMES;
/// Names of the conditions, in the order of their numbers.
pub const CONDITION_NAMES: [&str; conditions::COUNT] = conditions::NAMES;

/// Numbers in: see [`Sensed`].
const SENSORS: usize = 9;
/// Numbers out: the speeds of the left and of the right wheel.
const ACTUATORS: usize = 2;
const MOST_STATES: usize = 16;
/// As many as there are random numbers.
const MOST_TRANSITIONS: usize = 4;

/// Weights of a state without its transitions: behaviour, rwm, alpha, number of transitions.
const OF_STATE: usize = 4;
/// Weights of a transition: target, condition, probability, xi, eta.
const OF_TRANSITION: usize = 5;

/// Lowest and highest value of each weight of a state, and whether its fraction counts; then of a transition. A number of states or
/// transitions is limited further by the specification, and a target by the number of states.
const STATE_LIMITS: [(f32, f32, bool); OF_STATE] = [
    (0.0, (behaviours::COUNT - 1) as f32, false),
    (1.0, 100.0, false),
    (1.0, 5.0, false),
    (0.0, MOST_TRANSITIONS as f32, false),
];
const TRANSITION_LIMITS: [(f32, f32, bool); OF_TRANSITION] = [
    (0.0, MOST_STATES as f32, false),
    (0.0, (conditions::COUNT - 1) as f32, false),
    (0.0, 1.0, true),
    (1.0, 10.0, false),
    (0.0, 20.0, true),
];

/// Shorter proximity vectors do not count as obstacles.
const NEAR: f32 = 0.1;
/// Shorter vectors are not followed.
const SHORT: f32 = 0.1;
/// Ground is black up to here, and white from there on.
const BLACK: f32 = 0.1;
const WHITE: f32 = 0.95;

/// How states follow each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Form {
    /// A finite-state machine.
    #[default]
    Machine,
    /// A behaviour tree.
    Tree,
}

impl Form {
    #[allow(clippy::trivially_copy_pass_by_ref)] // serde's form
    fn is_machine(&self) -> bool {
        *self == Self::Machine
    }
}

/// A probabilistic finite-state machine as AutoMoDe-Chocolate designs them (G. Francesca et al., "AutoMoDe-Chocolate:
/// automatic design of control software for robot swarms", Swarm Intelligence 9, 2015), for differential drives.
///
/// A state has a behaviour, and transitions with conditions. In each step the behaviour of the state acts; then, unless the
/// state was entered in this step, one of the transitions whose conditions hold is made, all equally likely. The first
/// step is made in state 0. Random numbers come from a sensor, so that a step depends on sensors and state alone.
///
/// Sensors: the proximity vector (x ahead, y to the left), the light vector, the ground (0 black, 1 white), the number of neighbours, the
/// vector of attraction to them, and a random number in 0..1. Actuators: speeds of the left and the right wheel.
///
/// Weights: the number of states; for each state its behaviour, rwm, alpha, and the number of its transitions; and for each of
/// these its target, condition, probability, xi and eta. Of numbers and counts the whole part counts, and all are limited to
/// what is possible, so that any weights are a machine.
///
/// Or a behaviour tree as AutoMoDe-Maple designs them (J. Kuckling et al., "Behavior trees as a control architecture in the
/// automatic modular design of robot swarms", ANTS 2018): a sequence with memory of subtrees, each of which selects between
/// a condition and an action. A state is a subtree, with its one transition's condition. A step goes on with the subtree of the
/// last one: if its condition holds, with the next; else its behaviour acts. After the last the robot stops for a step, and
/// begins again with the first.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Modules {
    /// Machine or tree.
    #[serde(skip_serializing_if = "Form::is_machine")]
    pub form: Form,
    /// Numbers in: 9.
    pub sensors: usize,
    /// Numbers out: 2.
    pub actuators: usize,
    /// Most states.
    pub states: usize,
    /// Most transitions of a state.
    pub transitions: usize,
}

impl Modules {
    /// Weights of one state and its transitions.
    fn row_length(&self) -> usize {
        OF_STATE + self.transitions * OF_TRANSITION
    }
}

impl Modules {
    /// A step of a tree from this subtree on: the subtree of the next step, and the speeds.
    fn tick(
        &self,
        weights: &[f32],
        first: usize,
        sensed: &Sensed,
        turn: &mut f32,
        random: &Random<u32>,
    ) -> (usize, [f32; 2]) {
        let count = limited(weights[0], (1.0, self.states as f32, false)) as usize;
        let rows = weights[1..].chunks_exact(self.row_length()).enumerate();
        for (index, row) in rows.take(count).skip(first) {
            if random.unit(index) < probability(&row[OF_STATE..], sensed) {
                *turn = 0.0;
            } else {
                return (index, act(row, sensed, turn, random));
            }
        }
        *turn = 0.0;
        (0, [0.0, 0.0])
    }
}

/// A weight within its limits.
#[inline]
fn limited(weight: f32, (low, high, fraction): (f32, f32, bool)) -> f32 {
    let above = if weight < low { low } else { weight };
    let within = if above > high { high } else { above };
    if fraction { within } else { within.trunc() }
}

/// What is sensed.
struct Sensed {
    proximity: [f32; 2],
    light: [f32; 2],
    ground: f32,
    neighbours: f32,
    attraction: [f32; 2],
}

impl Sensed {
    fn new(sensors: &[f32]) -> Self {
        Self {
            proximity: [sensors[0], sensors[1]],
            light: [sensors[2], sensors[3]],
            ground: sensors[4],
            neighbours: sensors[5],
            attraction: [sensors[6], sensors[7]],
        }
    }

    fn obstacle_ahead(&self) -> bool {
        let [x, y] = self.proximity;
        (x * x + y * y).sqrt() >= NEAR && x >= 0.0
    }
}

/// What the behaviour of a state does.
fn act(row: &[f32], sensed: &Sensed, turn: &mut f32, random: &Random<u32>) -> [f32; 2] {
    let number = limited(row[0], STATE_LIMITS[0]) as usize;
    behaviours::act(number, row, sensed, turn, random)
}

impl Kind for Modules {
    const SIZE: (&'static str, &'static str) = ("states", "use fewer states");

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        let form = [Form::Machine, Form::Tree][reader.choice("form", &["machine", "tree"])?];
        // Each subtree draws a random number of its own.
        let (states, transitions) = match form {
            Form::Machine => (MOST_STATES, MOST_TRANSITIONS),
            Form::Tree => (MOST_TRANSITIONS, 1),
        };
        Ok(Self {
            form,
            sensors: reader.count("sensors", SENSORS, SENSORS)?,
            actuators: reader.count("actuators", ACTUATORS, ACTUATORS)?,
            states: reader.count("states", 1, states)?,
            transitions: reader.count("transitions", 1, transitions)?,
        })
    }

    fn weight_count(&self) -> Option<usize> {
        Some(1 + self.states * self.row_length())
    }

    fn sensors(&self) -> usize {
        self.sensors
    }

    fn actuators(&self) -> usize {
        self.actuators
    }

    /// The number of the state, whether it was entered before this step, and how many steps the robot still turns.
    fn state_length(&self) -> usize {
        3
    }

    fn scratch_length(&self) -> usize {
        0
    }

    fn current(&self, state: &[f32]) -> Option<u32> {
        state.first().map(|number| *number as u32)
    }

    #[inline]
    fn step(
        &self,
        weights: &[f32],
        state: &mut [f32],
        _scratch: &mut [f32],
        sensors: &[f32],
        actuators: &mut [f32],
    ) {
        let [current, settled, turn] = state else {
            return;
        };
        let sensed = Sensed::new(sensors);
        let random = Random::new(sensors[SENSORS - 1]);
        if self.form == Form::Tree {
            let (next, speeds) = self.tick(weights, *current as usize, &sensed, turn, &random);
            *current = next as f32;
            actuators.copy_from_slice(&speeds);
            return;
        }
        let row = &weights[1 + *current as usize * self.row_length()..][..self.row_length()];
        actuators.copy_from_slice(&act(row, &sensed, turn, &random));
        if *settled == 0.0 {
            *settled = 1.0;
            return;
        }
        let count = (limited(row[3], STATE_LIMITS[3]) as usize).min(self.transitions);
        let mut holding = [0; MOST_TRANSITIONS];
        let mut held = 0;
        for (index, transition) in row[OF_STATE..]
            .chunks_exact(OF_TRANSITION)
            .take(count)
            .enumerate()
        {
            if random.unit(index) < probability(transition, &sensed) {
                holding[held] = index;
                held += 1;
            }
        }
        if held > 0 {
            let chosen = holding[random.choice(held as u32) as usize];
            let target = limited(row[OF_STATE + chosen * OF_TRANSITION], TRANSITION_LIMITS[0]);
            let last = limited(weights[0], (1.0, self.states as f32, false)) - 1.0;
            *current = if target > last { last } else { target };
            *settled = 0.0;
            *turn = 0.0;
        }
    }
}
