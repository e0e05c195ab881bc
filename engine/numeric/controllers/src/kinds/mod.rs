//! The kinds of controller: a folder and a line of the list below for each.
//!
//! From the list follow [`Architecture`], the names in a specification, in error messages and in the capabilities of
//! servers, and what is called for a controller of the kind. Tests of the other languages compare their lists with
//! `protocol/schemas/controller.schema.json`, as `tests/kinds.rs` does with this one.

mod evostick;
mod fully_meshed;
mod growing;
mod hebbian;
mod layered;
mod mealy_fsm;
mod modules;
mod neat;
mod parameter_set;
mod python_modules;
mod team;

pub use evostick::Evostick;
pub use fully_meshed::FullyMeshed;
pub use growing::{Growing, NodeActivation};
pub use hebbian::Hebbian;
pub use layered::Layered;
pub use mealy_fsm::MealyFsm;
pub use modules::{BEHAVIOUR_NAMES, CONDITION_NAMES, Form, Modules};
pub use neat::Neat;
pub use parameter_set::{Parameter, ParameterKind, ParameterSet};
pub use python_modules::{Module, Needed, PythonModules};
pub use team::{Team, TeamGroup};

use crate::SpecificationError;
use crate::lanes::sums::write_numbers;
use crate::reader::Reader;
use serde::Serialize;
use serde_json::{Map, Value};
use swarmwright_lanes::Lanes;

/// A kind of controller: its specification, and inference for one agent.
pub(crate) trait Kind: Sized {
    /// The field that decides on the number of weights, and how to have fewer.
    const SIZE: (&'static str, &'static str);

    /// Reads the fields between `kind` and `weights`.
    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError>;

    /// Number of weights, biases included; none if it exceeds every limit.
    fn weight_count(&self) -> Option<usize>;

    /// Numbers in; 0 if it steers no agents.
    fn sensors(&self) -> usize;

    /// Numbers out; 0 if it steers no agents.
    fn actuators(&self) -> usize;

    /// Whether it steers agents.
    fn steers(&self) -> bool {
        true
    }

    /// Numbers that are kept between steps; all 0 at the start of an episode.
    fn state_length(&self) -> usize;

    /// Numbers that a step needs besides; their content does not matter.
    fn scratch_length(&self) -> usize;

    /// One step of one agent; all slices have the lengths above.
    fn step(
        &self,
        weights: &[f32],
        state: &mut [f32],
        scratch: &mut [f32],
        sensors: &[f32],
        actuators: &mut [f32],
    );

    /// The state that a state machine is in, from 0; none for other kinds. `state` is what is kept between steps.
    fn current(&self, _state: &[f32]) -> Option<u32> {
        None
    }

    /// Values of parameters of the simulation, by name.
    fn values(&self, _weights: &[f32]) -> Map<String, Value> {
        Map::new()
    }
}

/// Inference in lanes: the operations of [`Kind::step`] in the same order, for as many controllers as there are lanes.
pub(crate) trait LaneKind: Kind {
    /// Vectors of weights that are loaded. Default: 0, each lane takes its weights from its genome.
    #[inline(always)]
    fn lane_weights(&self) -> usize {
        0
    }

    /// Vectors that are kept between steps; all 0 at the start of an episode. Default: as many as numbers of a single controller.
    #[inline(always)]
    fn lane_state_length(&self) -> usize {
        self.state_length()
    }

    /// Vectors that a step needs besides. Default: those for sensors and actuators.
    #[inline(always)]
    fn lane_scratch_length(&self) -> usize {
        self.sensors() + self.actuators()
    }

    /// Changes weights that were loaded, once, to what makes steps short.
    #[inline(always)]
    fn prepare<L: Lanes>(&self, _weights: &mut [L]) {}

    /// One step of one agent in each lane. `weights`: vectors, and the genome of each lane; `numbers` and `bits`: see
    /// [`crate::LaneController::step_with_bits`]. Actuators are neither limited to -1..=1, nor is NaN replaced.
    ///
    /// All are arguments rather than fields of a struct, so that the compiler knows that they do not overlap and keeps
    /// sensors in registers; with a struct, layered networks lost up to a quarter of their speed.
    #[inline(always)]
    fn step_in_lanes<L: Lanes, const S: usize, const B: usize>(
        &self,
        weights: (&[L], &[&[f32]]),
        state: &mut [L],
        scratch: &mut [L],
        numbers: [L; S],
        bits: (L::Int, [u32; B]),
        actuators: &mut [L],
    ) {
        // Kinds to whom bits are numbers like others need the scratch for sensors and actuators alone. The actuators of
        // the caller, which are not handed to another function, stay in registers for other kinds.
        let (sensors, outputs) = scratch.split_at_mut(S + B);
        write_numbers(sensors, numbers, bits);
        outputs.copy_from_slice(actuators);
        L::apart(
            #[inline(always)]
            || self.step_slice_in_lanes(weights, state, &mut [], sensors, outputs),
        );
        actuators.copy_from_slice(outputs);
    }

    /// The same for a number of sensors that is known only at run time.
    fn step_slice_in_lanes<L: Lanes>(
        &self,
        weights: (&[L], &[&[f32]]),
        state: &mut [L],
        scratch: &mut [L],
        sensors: &[L],
        actuators: &mut [L],
    );
}

/// Makes kinds without lanes of their own: the groups of a team have some, parameters differ from lane to lane, and modules in
/// Python are not computed here. None of these functions is called.
macro_rules! without_lanes {
    ($($Kind:ident),+) => {
        $(impl LaneKind for $Kind {
            #[inline(always)]
            fn lane_weights(&self) -> usize {
                0
            }

            #[inline(always)]
            fn lane_state_length(&self) -> usize {
                0
            }

            #[inline(always)]
            fn lane_scratch_length(&self) -> usize {
                0
            }

            #[inline(always)]
            fn step_slice_in_lanes<L: Lanes>(
                &self,
                _: (&[L], &[&[f32]]),
                _: &mut [L],
                _: &mut [L],
                _: &[L],
                _: &mut [L],
            ) {
            }
        })+
    };
}

without_lanes!(ParameterSet, PythonModules, Team);

/// The name of several controllers in one specification. It is in no list of kinds: what an agent has is one of its parts.
pub const TEAM: &str = "team";

/// The name of machines with modules in Python. It is in no list of kinds: only servers that have such modules compute them.
pub const PYTHON_MODULES: &str = "python_modules";

/// Makes everything that follows from the list of kinds. `$d` is `$`, for the macro that it makes.
macro_rules! kinds {
    (($d:tt) $($(#[$doc:meta])* $name:literal => $Kind:ident,)+) => {
        /// Names of the kinds of controller in specifications and capabilities.
        pub const KINDS: &[&str] = &[$($name),+];

        /// A controller without its weights.
        #[derive(Debug, Clone, PartialEq, Serialize)]
        #[serde(tag = "kind")]
        pub enum Architecture {
            $($(#[$doc])* #[serde(rename = $name)] $Kind($Kind),)+
            /// Several kinds of agents with a controller each.
            #[serde(rename = "team")]
            Team(Team),
            /// A machine or a tree with modules in Python.
            #[serde(rename = "python_modules")]
            PythonModules(PythonModules),
        }

        /// Reads the fields of the kind with this name; none for an unknown name.
        pub(crate) fn read(name: &str, reader: &mut Reader<'_>) -> Option<Result<Architecture, SpecificationError>> {
            match name {
                $($name => Some($Kind::read(reader).map(Architecture::$Kind)),)+
                TEAM => Some(Team::read(reader).map(Architecture::Team)),
                PYTHON_MODULES => Some(PythonModules::read(reader).map(Architecture::PythonModules)),
                _ => None,
            }
        }

        /// The field that decides on the number of weights of an architecture, and how to have fewer.
        pub(crate) fn size(architecture: &Architecture) -> (&'static str, &'static str) {
            match architecture {
                $(Architecture::$Kind(_) => $Kind::SIZE,)+
                Architecture::Team(_) => Team::SIZE,
                Architecture::PythonModules(_) => PythonModules::SIZE,
            }
        }

        /// An expression for the kind inside of an architecture, whichever it is.
        macro_rules! of_kind {
            ($d architecture:expr, $d kind:ident => $d expression:expr) => {
                match $d architecture {
                    $(crate::Architecture::$Kind($d kind) => $d expression,)+
                    crate::Architecture::Team($d kind) => $d expression,
                    crate::Architecture::PythonModules($d kind) => $d expression,
                }
            };
        }
    };
}

kinds! { ($)
    /// Feed-forward layers.
    "layered" => Layered,
    /// FREVO's recurrent network.
    "fully_meshed" => FullyMeshed,
    /// A finite-state machine.
    "mealy_fsm" => MealyFsm,
    /// EvoStick's network.
    "evostick" => Evostick,
    /// FREVO's recurrent network that learns.
    "hebbian" => Hebbian,
    /// FREVO's network with given connections.
    "neat" => Neat,
    /// NEAT's network that grows.
    "growing" => Growing,
    /// A probabilistic finite-state machine, or a behaviour tree, of modules.
    "modules" => Modules,
    /// Parameters of a simulation that steers its agents itself.
    "parameter_set" => ParameterSet,
}

#[allow(clippy::single_component_path_imports)]
// makes the macro visible to modules above the list
pub(crate) use of_kind;
