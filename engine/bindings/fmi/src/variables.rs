//! Value references: which variable of the FMU has which number. Python writes modelDescription.xml by the same numbers
//! (`swarmwright/export/simulation_fmu.py`).

use crate::model::{Model, ParameterKind};

const FIRST_PARAMETER: usize = 100;
const FIRST_METRIC: usize = 10_000;
const FIRST_AGENT: usize = 100_000;

/// A variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variable {
    Time,
    Seed,
    Done,
    Fitness,
    Parameter(usize),
    Metric(usize),
    /// Whether the agent's actuators count in the next step.
    Acts(usize),
    /// By place among the sensors of all agents.
    Sensor(usize),
    /// Index among the actuators of all agents.
    Actuator(usize),
}

/// Of which type a variable is: in FMI 2.0 `Single` and `Double` are Real, `Integer` and `Seed` Integer; in FMI 3.0
/// Float32, Float64, Int64 and UInt64.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    Single,
    Double,
    Integer,
    Seed,
    Flag,
    Text,
}

impl Variable {
    /// The variable with a value reference.
    pub fn of(model: &Model, reference: u32) -> Option<Self> {
        let position = reference as usize;
        match position {
            0 => Some(Self::Time),
            1 => Some(Self::Seed),
            2 => Some(Self::Done),
            3 => Some(Self::Fitness),
            FIRST_PARAMETER..FIRST_METRIC => {
                let index = position - FIRST_PARAMETER;
                (index < model.parameters.len()).then_some(Self::Parameter(index))
            }
            FIRST_METRIC..FIRST_AGENT => {
                let index = position - FIRST_METRIC;
                (index < model.metrics.len()).then_some(Self::Metric(index))
            }
            FIRST_AGENT.. => {
                let each = 1 + model.sensors + model.actuators;
                let (agent, index) = (
                    (position - FIRST_AGENT) / each,
                    (position - FIRST_AGENT) % each,
                );
                (agent < model.agents).then(|| match index {
                    0 => Self::Acts(agent),
                    index if index <= model.sensors => {
                        Self::Sensor(agent * model.sensors + index - 1)
                    }
                    index => Self::Actuator(agent * model.actuators + index - 1 - model.sensors),
                })
            }
            _ => None,
        }
    }

    /// Its type.
    pub fn kind(self, model: &Model) -> Type {
        match self {
            Self::Time | Self::Fitness | Self::Metric(_) => Type::Double,
            Self::Seed => Type::Seed,
            Self::Done | Self::Acts(_) => Type::Flag,
            Self::Sensor(_) | Self::Actuator(_) => Type::Single,
            Self::Parameter(index) => match model.parameters[index].kind {
                ParameterKind::Number => Type::Double,
                ParameterKind::Integer => Type::Integer,
                ParameterKind::Flag => Type::Flag,
                ParameterKind::Text | ParameterKind::Json => Type::Text,
            },
        }
    }

    /// Its name, for messages.
    pub fn name(self, model: &Model) -> String {
        match self {
            Self::Time => "time".to_owned(),
            Self::Seed => "seed".to_owned(),
            Self::Done => "done".to_owned(),
            Self::Fitness => "fitness".to_owned(),
            Self::Parameter(index) => model.parameters[index].name.clone(),
            Self::Metric(index) => format!("metrics.{}", model.metrics[index]),
            Self::Acts(agent) => format!("agent[{}].acts", agent + 1),
            Self::Sensor(index) => of_agent("sensor", index, model.sensors),
            Self::Actuator(index) => of_agent("actuator", index, model.actuators),
        }
    }
}

fn of_agent(kind: &str, index: usize, each: usize) -> String {
    format!("{kind} {} of agent {}", index % each + 1, index / each + 1)
}
