//! An instance of an FMU: its variables, its time, its states.

use std::ffi::CString;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use swarmwright_worlds::Parameters;

use crate::local::Local;
use crate::log::{Log, Status};
use crate::model::{Model, ParameterKind};
use crate::remote::Remote;
use crate::shield::Refusal;
use crate::variables::{Type, Variable};
use crate::world::World;

/// Masters add up step sizes, and rounding errors with them: so much of a period may be missing.
const SLACK: f64 = 1e-3;

/// Names of parameters that say how a proxy reaches its server begin with this.
const CONNECTION: &str = "connection.";

/// A value of a variable.
#[derive(Debug, Clone, PartialEq)]
pub enum Worth {
    Number(f64),
    Integer(i64),
    Seed(u64),
    Flag(bool),
    Text(String),
}

/// Where an instance is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Phase {
    /// Parameters can be set.
    Instantiated,
    /// Parameters can be set; outputs are those at the start.
    Initialization,
    /// In an episode.
    Stepping,
    Terminated,
}

/// What an instance remembers: from it the episode can be repeated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    phase: Phase,
    /// Seconds.
    start: f64,
    time: f64,
    /// By parameter of the model.
    parameters: Vec<Value>,
    seed: u64,
    /// (agents, actuators)
    inputs: Vec<f32>,
    /// Steps that were made.
    made: u64,
    /// Their (agents, actuators), where they can be repeated.
    steps: Vec<Vec<f32>>,
}

/// See the module.
pub struct Instance {
    pub log: Log,
    pub model: Model,
    world: Box<dyn World>,
    state: State,
    /// Whether the world is where the state is.
    current: bool,
    /// Texts that were handed over, until the next call that does.
    pub texts: Vec<CString>,
}

impl Instance {
    /// An instance, unless the identifier is another FMU's.
    pub fn new(log: Log, model: Model, token: &str, of: &str) -> Option<Box<Self>> {
        if token != model.token {
            log.tell(
                Status::Error,
                &format!("the {of} differs from that in modelDescription.xml"),
            );
            return None;
        }
        let world: Result<Box<dyn World>, String> = if model.dimensions.is_some() {
            Ok(Box::new(Remote::new(&model)))
        } else {
            Local::new(&model).map(|world| Box::new(world) as Box<dyn World>)
        };
        let world = match world {
            Ok(world) => world,
            Err(reason) => {
                log.tell(Status::Error, &reason);
                return None;
            }
        };
        let state = State {
            phase: Phase::Instantiated,
            start: 0.0,
            time: 0.0,
            parameters: model
                .parameters
                .iter()
                .map(|parameter| parameter.start.clone())
                .collect(),
            seed: model.seed,
            inputs: vec![0.0; model.agents * model.actuators],
            made: 0,
            steps: Vec::new(),
        };
        Some(Box::new(Self {
            log,
            model,
            world,
            state,
            current: false,
            texts: Vec::new(),
        }))
    }

    /// Back to what it was when it was made.
    pub fn reset(&mut self) {
        self.world.end();
        self.current = false;
        self.state = State {
            phase: Phase::Instantiated,
            start: 0.0,
            time: 0.0,
            parameters: self
                .model
                .parameters
                .iter()
                .map(|parameter| parameter.start.clone())
                .collect(),
            seed: self.model.seed,
            inputs: vec![0.0; self.state.inputs.len()],
            made: 0,
            steps: Vec::new(),
        };
    }

    /// The time of the first step begins here.
    pub fn set_start(&mut self, start: f64) -> Result<(), Refusal> {
        if !start.is_finite() {
            return Err("the start time is not a finite number".into());
        }
        (self.state.start, self.state.time) = (start, start);
        Ok(())
    }

    pub fn enter_initialization(&mut self) -> Result<(), Refusal> {
        if self.state.phase != Phase::Instantiated {
            return Err("initialization was already entered; reset the instance first".into());
        }
        self.state.phase = Phase::Initialization;
        Ok(())
    }

    pub fn exit_initialization(&mut self) -> Result<(), Refusal> {
        if self.state.phase != Phase::Initialization {
            return Err("initialization cannot be left before it is entered".into());
        }
        self.catch_up()?;
        self.state.phase = Phase::Stepping;
        Ok(())
    }

    /// Ends the episode; its outputs can still be read.
    pub fn terminate(&mut self) {
        self.world.end();
        self.state.phase = Phase::Terminated;
    }

    /// Seconds where the last step ended.
    pub fn time(&self) -> f64 {
        self.state.time
    }

    /// Takes the world to where the state is.
    fn catch_up(&mut self) -> Result<(), Refusal> {
        if self.current {
            return Ok(());
        }
        let (parameters, connection) = self.parameters()?;
        self.world.begin(&parameters, &connection)?;
        for step in &self.state.steps {
            self.world.step(step)?;
        }
        self.current = true;
        Ok(())
    }

    /// Those of the episode, what was set at the export, and what the master has set since; and those of the connection.
    fn parameters(&self) -> Result<(Parameters, Parameters), Refusal> {
        let mut parameters = self.model.base.clone();
        let mut connection = Parameters::new();
        for (parameter, value) in self.model.parameters.iter().zip(&self.state.parameters) {
            if let Some(name) = parameter.name.strip_prefix(CONNECTION)
                && self.model.dimensions.is_some()
            {
                connection.insert(name.to_owned(), value.clone());
            } else if *value != parameter.start {
                parameters.insert(
                    parameter.name.clone(),
                    value_of(&parameter.name, parameter.kind, value)?,
                );
            }
        }
        parameters.insert("seed".to_owned(), self.state.seed.into());
        Ok((parameters, connection))
    }

    /// The variable, and whether it is of a type.
    fn variable(
        &self,
        reference: u32,
        is: fn(Type) -> bool,
        type_name: &str,
    ) -> Result<Variable, Refusal> {
        let variable = Variable::of(&self.model, reference)
            .ok_or_else(|| format!("no variable has the value reference {reference}"))?;
        if is(variable.kind(&self.model)) {
            Ok(variable)
        } else {
            let name = variable.name(&self.model);
            Err(
                format!("{name} (value reference {reference}) is not of the type {type_name}")
                    .into(),
            )
        }
    }

    /// The value of a variable.
    pub fn get(
        &mut self,
        reference: u32,
        is: fn(Type) -> bool,
        type_name: &str,
    ) -> Result<Worth, Refusal> {
        let variable = self.variable(reference, is, type_name)?;
        let needs_world = matches!(
            variable,
            Variable::Done
                | Variable::Fitness
                | Variable::Metric(_)
                | Variable::Acts(_)
                | Variable::Sensor(_)
        );
        if needs_world && self.state.phase == Phase::Initialization {
            self.catch_up()?;
        }
        let view = self.world.view();
        Ok(match variable {
            Variable::Time => Worth::Number(self.state.time),
            Variable::Seed => Worth::Seed(self.state.seed),
            Variable::Done => Worth::Flag(view.done),
            Variable::Fitness => Worth::Number(view.fitness),
            Variable::Metric(index) => Worth::Number(view.metrics[index]),
            Variable::Acts(agent) => Worth::Flag(view.acts[agent]),
            Variable::Sensor(index) => Worth::Number(view.sensors[index].into()),
            Variable::Actuator(index) => Worth::Number(self.state.inputs[index].into()),
            Variable::Parameter(index) => {
                let value = &self.state.parameters[index];
                match self.model.parameters[index].kind {
                    ParameterKind::Number => Worth::Number(value.as_f64().unwrap_or(f64::NAN)),
                    ParameterKind::Integer => Worth::Integer(value.as_i64().unwrap_or(0)),
                    ParameterKind::Flag => Worth::Flag(value.as_bool().unwrap_or(false)),
                    ParameterKind::Text | ParameterKind::Json => {
                        Worth::Text(value.as_str().unwrap_or("").to_owned())
                    }
                }
            }
        })
    }

    /// Sets a variable.
    pub fn set(
        &mut self,
        reference: u32,
        is: fn(Type) -> bool,
        type_name: &str,
        value: Worth,
    ) -> Result<(), Refusal> {
        let variable = self.variable(reference, is, type_name)?;
        match (variable, value) {
            (Variable::Actuator(index), Worth::Number(value)) => {
                self.state.inputs[index] = value as f32;
                Ok(())
            }
            (Variable::Seed, Worth::Seed(seed)) => {
                self.settable(variable)?;
                self.state.seed = seed;
                self.current = false;
                Ok(())
            }
            (Variable::Parameter(index), value) => {
                self.settable(variable)?;
                let value = match value {
                    Worth::Number(number) if !number.is_finite() => {
                        let name = &self.model.parameters[index].name;
                        return Err(
                            format!("parameter {name}: {number} is not a finite number").into()
                        );
                    }
                    Worth::Number(number) => Value::from(number),
                    Worth::Integer(integer) => Value::from(integer),
                    Worth::Seed(seed) => Value::from(seed),
                    Worth::Flag(flag) => Value::from(flag),
                    Worth::Text(text) => Value::from(text),
                };
                self.state.parameters[index] = value;
                self.current = false;
                Ok(())
            }
            _ => {
                let name = variable.name(&self.model);
                Err(format!("{name} is an output and cannot be set").into())
            }
        }
    }

    fn settable(&self, variable: Variable) -> Result<(), Refusal> {
        if matches!(
            self.state.phase,
            Phase::Instantiated | Phase::Initialization
        ) {
            return Ok(());
        }
        let name = variable.name(&self.model);
        Err(format!(
            "{name} is a parameter: it can be set until initialization ends, and again after a reset"
        )
        .into())
    }

    /// Makes the steps that end within a step of the master.
    pub fn advance(&mut self, time: f64, size: f64) -> Result<(), Refusal> {
        if self.state.phase != Phase::Stepping {
            return Err("a step needs an episode: leave initialization first".into());
        }
        if !time.is_finite() || !size.is_finite() || size < 0.0 {
            return Err(
                "a communication step must have a finite time and a size of at least 0 s".into(),
            );
        }
        self.follows(time, size)?;
        self.catch_up()?;
        let end = (time + size - self.state.start) / self.model.period + SLACK;
        let inputs = self.limited()?;
        while (self.state.made + 1) as f64 <= end && !self.world.view().done {
            self.world.step(&inputs)?;
            if self.world.goes_back() {
                self.state.steps.push(inputs.clone());
            }
            self.state.made += 1;
        }
        self.state.time = time + size;
        Ok(())
    }

    /// Refuses a step that does not begin where the last one ended, but for rounding errors of the master: these may be
    /// [`SLACK`] of the step or period, and some units in the last place of the time.
    fn follows(&self, time: f64, size: f64) -> Result<(), Refusal> {
        let State {
            start, time: last, ..
        } = self.state;
        let shortest = if size > 0.0 && size < self.model.period {
            size
        } else {
            self.model.period
        };
        if (time - last).abs() <= SLACK * shortest + 8.0 * f64::EPSILON * time.abs() {
            return Ok(());
        }
        let expected = if last == start {
            "start time that was set up is"
        } else {
            "last one ended at"
        };
        Err(format!("the step begins at {time} s, but the {expected} {last} s").into())
    }

    /// The inputs, limited to -1..=1 as servers do.
    fn limited(&self) -> Result<Vec<f32>, Refusal> {
        let acts = &self.world.view().acts;
        let each = self.model.actuators.max(1);
        let limited = self.state.inputs.iter().enumerate().map(|(index, value)| {
            if value.is_finite() {
                Ok(value.clamp(-1.0, 1.0))
            } else if acts[index / each] {
                let name = Variable::Actuator(index).name(&self.model);
                Err(Refusal::Discard(format!(
                    "{name} is {value}, not a finite number; the step was not made"
                )))
            } else {
                Ok(0.0)
            }
        });
        limited.collect()
    }

    /// A copy of the state.
    pub fn state(&self) -> Result<Box<State>, Refusal> {
        if self.world.goes_back() {
            Ok(Box::new(self.state.clone()))
        } else {
            Err(
                "states cannot be saved, since a simulation server cannot return to an earlier step"
                    .into(),
            )
        }
    }

    /// Goes to a state: the steps up to it are repeated, unless they are those that were made.
    pub fn set_state(&mut self, state: &State) -> Result<(), Refusal> {
        let fits = self.world.goes_back()
            && state.made == state.steps.len() as u64
            && state.inputs.len() == self.state.inputs.len()
            && state.parameters.len() == self.state.parameters.len()
            && state
                .steps
                .iter()
                .all(|step| step.len() == self.state.inputs.len());
        if !fits {
            return Err("the state belongs to another FMU".into());
        }
        let same = self.current
            && state.seed == self.state.seed
            && state.parameters == self.state.parameters
            && state.steps.starts_with(&self.state.steps);
        let done = self.state.steps.len();
        self.state = state.clone();
        if same {
            for step in &self.state.steps[done..] {
                self.world.step(step)?;
            }
        } else {
            self.current = false;
            if self.state.phase != Phase::Instantiated {
                self.catch_up()?;
            }
        }
        Ok(())
    }
}

/// A parameter as the simulation takes it.
fn value_of(name: &str, kind: ParameterKind, value: &Value) -> Result<Value, Refusal> {
    let text = value.as_str().unwrap_or("");
    match kind {
        ParameterKind::Json => match serde_json::from_str(text) {
            Ok(value) => Ok(value),
            // A name, where a name or an object is possible.
            Err(_) if !text.starts_with(['[', '{', '"']) => Ok(value.clone()),
            Err(error) => {
                Err(format!("parameter {name}: {text:?} is not valid JSON: {error}").into())
            }
        },
        _ => Ok(value.clone()),
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        self.world.end();
    }
}

/// Hexadecimal digits of a checksum.
const DIGITS: usize = 16;

/// A state as bytes, and back: a checksum, then JSON.
impl State {
    /// `token`: of the FMU.
    pub fn bytes(&self, token: &str) -> Result<Vec<u8>, Refusal> {
        let json = serde_json::to_vec(self).map_err(|error| error.to_string())?;
        let mut bytes = checksum(token, &json).into_bytes();
        bytes.extend(json);
        Ok(bytes)
    }

    /// Refuses bytes that are damaged, or a state of an FMU with another token; blanks at the end are ignored.
    pub fn read(bytes: &[u8], token: &str) -> Result<Box<Self>, Refusal> {
        let (sum, json) = bytes
            .trim_ascii_end()
            .split_at_checked(DIGITS)
            .ok_or("the bytes are not a state of this FMU")?;
        if sum != checksum(token, json).as_bytes() {
            return Err(
                "the bytes are not a state of this FMU, or are damaged: the checksum differs"
                    .into(),
            );
        }
        serde_json::from_slice(json)
            .map(Box::new)
            .map_err(|error| format!("the bytes are not a state of this FMU: {error}").into())
    }
}

/// FNV-1a, 64 bits, in hexadecimal digits.
fn checksum(token: &str, bytes: &[u8]) -> String {
    let sum = token
        .bytes()
        .chain(bytes.iter().copied())
        .fold(0xcbf2_9ce4_8422_2325_u64, |sum, byte| {
            (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
    format!("{sum:0DIGITS$x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> State {
        State {
            phase: Phase::Stepping,
            start: 0.5,
            time: 1.25,
            parameters: vec![Value::from("fixed")],
            seed: 7,
            inputs: vec![0.1, -1.0],
            made: 1,
            steps: vec![vec![0.25, 0.5]],
        }
    }

    #[test]
    fn a_state_is_read_from_its_bytes() {
        let mut bytes = state().bytes("{a}").expect("finite numbers");
        assert_eq!(State::read(&bytes, "{a}"), Ok(Box::new(state())));
        bytes.extend(b"   ");
        assert_eq!(State::read(&bytes, "{a}"), Ok(Box::new(state())));
    }

    #[test]
    fn damaged_states_and_those_of_other_fmus_are_refused() {
        let bytes = state().bytes("{a}").expect("finite numbers");
        for place in 0..bytes.len() {
            for bit in 0..8 {
                let mut damaged = bytes.clone();
                damaged[place] ^= 1 << bit;
                assert!(State::read(&damaged, "{a}").is_err(), "{place}, {bit}");
            }
            assert!(State::read(&bytes[..place], "{a}").is_err(), "{place}");
        }
        assert!(State::read(&bytes, "{b}").is_err());
    }
}
