//! The controller of one agent.

use crate::kinds::{Kind, of_kind};
use crate::{Architecture, Specification};
use serde_json::{Map, Value};
use std::borrow::Cow;
use std::sync::Arc;

/// Why a controller did not step; its state is then unchanged.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ControllerError {
    /// A parameter set was asked to steer.
    #[error(
        "an agent is to be steered, but a parameter set steers no agents: the simulation must do that itself \
         (Minisim does with the parameter steering: rule), or the controller must be of another kind, such as layered"
    )]
    SteersNoAgents,
    /// A sensor reading of the wrong length.
    #[error("sensors: {found} numbers, but this controller takes {expected}")]
    SensorCount {
        /// Length that the specification asks for.
        expected: usize,
        /// Length that was given.
        found: usize,
    },
    /// A sensor that is NaN or infinite.
    #[error("sensors[{index}] is NaN or infinite, but every sensor must be a finite number")]
    SensorValue {
        /// Which sensor, from 0.
        index: usize,
    },
    /// A slice for the wrong number of actuators.
    #[error("actuators: a slice of {found} numbers, but this controller gives {expected}")]
    ActuatorCount {
        /// Length that the specification gives.
        expected: usize,
        /// Length that was offered.
        found: usize,
    },
    /// A number of weights other than the architecture needs.
    #[error("weights: {found} numbers, but this controller needs {expected}")]
    WeightCount {
        /// Weights that the architecture needs.
        expected: usize,
        /// Weights that were given.
        found: usize,
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
                found: weights.len(),
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
            weights,
            state: vec![0.0; state].into_boxed_slice(),
            scratch: vec![0.0; scratch].into_boxed_slice(),
        }
    }

    /// The specification: architecture and weights, without any state.
    pub fn specification(&self) -> Specification {
        Specification::of(&self.architecture, &self.weights)
    }

    /// Whether it steers agents; a parameter set does not.
    pub fn steers(&self) -> bool {
        self.architecture.steers()
    }

    /// Values of parameters of the simulation, by name; empty unless it is a parameter set.
    pub fn parameters(&self) -> Map<String, Value> {
        of_kind!(&*self.architecture, kind => kind.values(&self.weights))
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

    /// The state in which a state machine makes its next step, from 0; none for other kinds of controllers.
    pub fn current(&self) -> Option<u32> {
        of_kind!(&*self.architecture, kind => kind.current(&self.state))
    }

    /// One step: writes the actuators, each in -1..=1, for `sensors`. Allocates nothing.
    ///
    /// An overflow inside the network that ends in a NaN gives the actuator 0.
    ///
    /// # Errors
    /// Slices of the wrong length, a sensor that is NaN or infinite, a parameter set.
    pub fn step(&mut self, sensors: &[f32], actuators: &mut [f32]) -> Result<(), ControllerError> {
        if !self.steers() {
            return Err(ControllerError::SteersNoAgents);
        }
        if sensors.len() != self.sensors() {
            return Err(ControllerError::SensorCount {
                expected: self.sensors(),
                found: sensors.len(),
            });
        }
        if actuators.len() != self.actuators() {
            return Err(ControllerError::ActuatorCount {
                expected: self.actuators(),
                found: actuators.len(),
            });
        }
        if let Some(index) = sensors.iter().position(|s| !s.is_finite()) {
            return Err(ControllerError::SensorValue { index });
        }
        let (state, scratch) = (&mut self.state, &mut self.scratch);
        of_kind!(&*self.architecture, kind => kind.step(&self.weights, state, scratch, sensors, actuators));
        Ok(())
    }
}
