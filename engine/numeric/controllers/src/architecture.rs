//! What controllers of one experiment have in common: everything but the weights.

use crate::kinds::{self, KINDS, Kind, PythonModules, TEAM, Team, of_kind};
use crate::reader::{Reader, wrong};
use crate::{Architecture, MAX_WEIGHTS, SpecificationError, VERSION};

impl Architecture {
    /// Reads a specification and ignores its weights, which may be missing.
    ///
    /// # Errors
    /// Text that is not a JSON object; a field that is missing, unknown, of the wrong type or out of range.
    pub fn from_json(text: &str) -> Result<Self, SpecificationError> {
        let mut reader = Reader::new(text)?;
        let architecture = Self::read(&mut reader)?;
        reader.skip_weights();
        reader.end()?;
        Ok(architecture)
    }

    pub(crate) fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        reader.count("version", VERSION as usize, VERSION as usize)?;
        let expected = alternatives(&[KINDS, &[TEAM]].concat());
        let name = reader.text("kind", &expected)?;
        let Some(architecture) = kinds::read(&name, reader) else {
            return Err(wrong(
                "kind",
                format!("{name:?} found, expected {expected}"),
            ));
        };
        let architecture = architecture?;
        let (field, smaller) = kinds::size(&architecture);
        match architecture.checked_weight_count() {
            Some(count) if count <= MAX_WEIGHTS => Ok(architecture),
            Some(count) => Err(wrong(
                field,
                format!("makes {count} weights; {smaller}, at most {MAX_WEIGHTS}"),
            )),
            None => Err(wrong(
                field,
                format!("makes too many weights; at most {MAX_WEIGHTS} are possible"),
            )),
        }
    }

    fn checked_weight_count(&self) -> Option<usize> {
        of_kind!(self, kind => kind.weight_count())
    }

    /// Number of weights, biases included.
    pub fn weight_count(&self) -> usize {
        self.checked_weight_count().unwrap_or(usize::MAX)
    }

    /// Whether agents are steered: not by a parameter set, which fits any simulation.
    pub fn steers(&self) -> bool {
        of_kind!(self, kind => kind.steers())
    }

    /// The groups of agents, if these have different controllers.
    pub fn team(&self) -> Option<&Team> {
        match self {
            Self::Team(team) => Some(team),
            _ => None,
        }
    }

    /// Whether it is a state machine or a tree, whose state is known; not a team, whose groups may be.
    pub fn has_states(&self) -> bool {
        of_kind!(self, kind => kind.current(&[0.0])).is_some()
    }

    /// The state in which an agent begins; `None` if its controller has no states.
    pub(crate) fn first_state(&self, agent: u32) -> Option<u32> {
        let own = match self.team() {
            Some(team) => &*team.group_of(agent)?.0.controller,
            None => self,
        };
        own.has_states().then_some(0)
    }

    /// The machine, if it has modules in Python: then this crate does not compute it.
    pub fn in_python(&self) -> Option<&PythonModules> {
        match self {
            Self::PythonModules(machine) => Some(machine),
            _ => None,
        }
    }

    /// Numbers in; 0 if it steers no agents.
    pub fn sensors(&self) -> usize {
        of_kind!(self, kind => kind.sensors())
    }

    /// Numbers out; 0 if it steers no agents.
    pub fn actuators(&self) -> usize {
        of_kind!(self, kind => kind.actuators())
    }
}

/// Names in quotes, such as "a", "b" or "c".
fn alternatives(names: &[&str]) -> String {
    let quoted: Vec<String> = names.iter().map(|name| format!("{name:?}")).collect();
    match quoted.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
        _ => quoted.concat(),
    }
}
