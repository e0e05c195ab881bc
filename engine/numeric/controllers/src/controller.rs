//! The controller of one agent.

use crate::kinds::{Kind, Team, of_kind};
use crate::{Architecture, Specification};
use serde_json::{Map, Value};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// Why a controller did not step; its state is then unchanged.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ControllerError {
    /// A parameter set was asked to steer.
    #[error(
        "a parameter set steers no agents; use a controller of another kind, such as layered, or a simulation that steers its \
         agents (Minisim does with the parameter steering: rule)"
    )]
    SteersNoAgents,
    /// A team was asked to steer instead of one of its controllers.
    #[error("a team has a controller for each agent; use the controller of an agent")]
    NoAgent,
    /// A machine with modules in Python was asked to steer.
    #[error(
        "a machine with modules in Python can only be computed in Python; evaluate it in the process of the tool or on a server \
         with these modules"
    )]
    InPython,
    /// An agent that belongs to no group of a team.
    #[error(
        "agent {agent} belongs to no group: the groups of the controller have {agents} agents, from 0 to {}",
        .agents - 1
    )]
    NoGroup {
        /// Which agent.
        agent: u32,
        /// How many agents all groups have.
        agents: u32,
    },
    /// A sensor reading of the wrong length.
    #[error("sensors: {actual} numbers, but this controller takes {expected}")]
    SensorCount {
        /// Length that the specification asks for.
        expected: usize,
        /// Length that was given.
        actual: usize,
    },
    /// A sensor that is NaN or infinite.
    #[error("sensors[{index}] is NaN or infinite, but every sensor must be a finite number")]
    SensorValue {
        /// Which sensor, from 0.
        index: usize,
    },
    /// A slice for the wrong number of actuators.
    #[error("actuators: a slice of {actual} numbers, but this controller gives {expected}")]
    ActuatorCount {
        /// Length that the specification gives.
        expected: usize,
        /// Length that was offered.
        actual: usize,
    },
    /// The number of weights does not match the architecture.
    #[error("weights: {actual} numbers, but this controller needs {expected}")]
    WeightCount {
        /// Weights that the architecture needs.
        expected: usize,
        /// Number of given weights.
        actual: usize,
    },
    /// A weight that is NaN or infinite.
    #[error("weights[{index}] is NaN or infinite, but every weight must be a finite number")]
    WeightValue {
        /// Which weight, from 0.
        index: usize,
    },
}

/// Sensors in, actuators out, for one agent. A clone shares the weights and has a state of its own.
#[derive(Debug, Clone)]
pub struct Controller {
    architecture: Arc<Architecture>,
    weights: Arc<[f32]>,
    /// Those of the above that are this controller's: all but in a team.
    own: Range<usize>,
    /// In a team, the most sensors and actuators that any agent has: rows may be as long; 0, 0 otherwise.
    row: (u32, u32),
    /// Kept between steps: the outputs of all nodes of a fully meshed network, the state of a finite-state machine.
    state: Box<[f32]>,
    scratch: Box<[f32]>,
}

impl Controller {
    /// A controller at the start of an episode.
    pub fn new(specification: &Specification) -> Self {
        Self::build(
            Arc::new(specification.architecture().clone()),
            specification.weights().into(),
        )
    }

    /// A controller of a checked architecture with weights from elsewhere, such as a block of genomes.
    ///
    /// # Errors
    /// A wrong number of weights, or one that is NaN or infinite.
    pub fn with_weights(
        architecture: &Arc<Architecture>,
        weights: Arc<[f32]>,
    ) -> Result<Self, ControllerError> {
        let expected = architecture.weight_count();
        if weights.len() != expected {
            return Err(ControllerError::WeightCount {
                expected,
                actual: weights.len(),
            });
        }
        if let Some(index) = weights.iter().position(|w| !w.is_finite()) {
            return Err(ControllerError::WeightValue { index });
        }
        Ok(Self::build(Arc::clone(architecture), weights))
    }

    fn build(architecture: Arc<Architecture>, weights: Arc<[f32]>) -> Self {
        let (state, scratch) =
            of_kind!(&*architecture, kind => (kind.state_length(), kind.scratch_length()));
        Self {
            architecture,
            own: 0..weights.len(),
            weights,
            row: (0, 0),
            state: vec![0.0; state].into_boxed_slice(),
            scratch: vec![0.0; scratch].into_boxed_slice(),
        }
    }

    /// Whatever it is but its weights.
    pub(crate) fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    /// The specification: architecture and weights, without any state.
    pub fn specification(&self) -> Specification {
        Specification::of(&self.architecture, &self.weights[self.own.clone()])
    }

    /// The controller of an agent at the start of an episode, which shares the weights: in a team that of its group, otherwise
    /// this one.
    ///
    /// # Errors
    /// An agent that belongs to no group of the team.
    pub fn of_agent(&self, agent: u32) -> Result<Self, ControllerError> {
        let Some(team) = self.architecture.team() else {
            let mut controller = self.clone();
            controller.reset();
            return Ok(controller);
        };
        let (group, own) = team.group_of(agent).ok_or(ControllerError::NoGroup {
            agent,
            agents: team.agents().unwrap_or(u32::MAX),
        })?;
        Ok(Self {
            own,
            row: (team.sensors() as u32, team.actuators() as u32),
            ..Self::build(Arc::clone(&group.controller), Arc::clone(&self.weights))
        })
    }

    /// The groups of agents, if these have different controllers.
    pub fn team(&self) -> Option<&Team> {
        self.architecture.team()
    }

    /// Whether it steers agents; a parameter set does not.
    pub fn steers(&self) -> bool {
        self.architecture.steers()
    }

    /// Values of parameters of the simulation, by name; empty unless it is a parameter set.
    pub fn parameters(&self) -> Map<String, Value> {
        of_kind!(&*self.architecture, kind => kind.values(&self.weights[self.own.clone()]))
    }

    /// The parameters of an episode: those given, replaced or extended by those of a parameter set.
    pub fn merged<'a>(&self, parameters: &'a Map<String, Value>) -> Cow<'a, Map<String, Value>> {
        let values = self.parameters();
        if values.is_empty() {
            return Cow::Borrowed(parameters);
        }
        let mut merged = parameters.clone();
        merged.extend(values);
        Cow::Owned(merged)
    }

    /// Numbers in; 0 for a parameter set.
    pub fn sensors(&self) -> usize {
        self.architecture.sensors()
    }

    /// Numbers out; 0 for a parameter set.
    pub fn actuators(&self) -> usize {
        self.architecture.actuators()
    }

    /// Back to the start of an episode: clears the state.
    pub fn reset(&mut self) {
        self.state.fill(0.0);
    }

    /// The state in which a state machine makes its next step, from 0; `None` for other kinds of controllers.
    pub fn current(&self) -> Option<u32> {
        of_kind!(&*self.architecture, kind => kind.current(&self.state))
    }

    /// One step: writes the actuators, each in -1..=1, for `sensors`. Allocates nothing.
    ///
    /// An overflow inside the network that ends in a NaN gives the actuator 0. In a team, both may also be as long as those of
    /// the agent that has most: sensors at the end do not count then, and actuators at the end are 0.
    ///
    /// # Errors
    /// Slices of the wrong length, a sensor that is NaN or infinite, a parameter set, a machine with modules in Python.
    pub fn step(&mut self, sensors: &[f32], actuators: &mut [f32]) -> Result<(), ControllerError> {
        if !self.steers() {
            return Err(ControllerError::SteersNoAgents);
        }
        if self.architecture.team().is_some() {
            return Err(ControllerError::NoAgent);
        }
        if self.architecture.in_python().is_some() {
            return Err(ControllerError::InPython);
        }
        let (own_sensors, own_actuators) = (self.sensors(), self.actuators());
        let row = (self.row.0 as usize, self.row.1 as usize);
        let sensors = if sensors.len() == row.0 && row.0 > own_sensors {
            &sensors[..own_sensors]
        } else {
            sensors
        };
        let actuators = if actuators.len() == row.1 && row.1 > own_actuators {
            let (actuators, rest) = actuators.split_at_mut(own_actuators);
            rest.fill(0.0);
            actuators
        } else {
            actuators
        };
        if sensors.len() != own_sensors {
            return Err(ControllerError::SensorCount {
                expected: own_sensors,
                actual: sensors.len(),
            });
        }
        if actuators.len() != own_actuators {
            return Err(ControllerError::ActuatorCount {
                expected: own_actuators,
                actual: actuators.len(),
            });
        }
        // All at once, as none is wrong as a rule.
        if !sensors.iter().fold(true, |all, s| all & s.is_finite())
            && let Some(index) = sensors.iter().position(|s| !s.is_finite())
        {
            return Err(ControllerError::SensorValue { index });
        }
        let weights = &self.weights[self.own.clone()];
        let (state, scratch) = (&mut self.state, &mut self.scratch);
        of_kind!(&*self.architecture, kind => kind.step(weights, state, scratch, sensors, actuators));
        Ok(())
    }
}
