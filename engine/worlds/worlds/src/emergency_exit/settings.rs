//! Parameters of Emergency Exit: names, defaults, ranges.

use super::field::{Field, RandomField};
use crate::parameters::wrong;
use crate::{ParameterError, ParameterInfo, ParameterReader, Parameters};
use serde_json::{Value, json};

/// Most agents.
pub(super) const MAX_AGENTS: u32 = 100_000;
/// Most columns, and most rows.
pub(super) const MAX_SIDE: u32 = 2000;
const MAX_CELLS: u32 = MAX_SIDE * MAX_SIDE;
const MAX_STEPS: u32 = 10_000_000;
const MAX_STEP_SIZE: u32 = 3_600_000;

/// The order in which agents act.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Update {
    /// One after another, as in FREVO.
    Sequential,
    /// All sense, then all move.
    Simultaneous,
}

/// Checked parameters, but for the field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Settings {
    pub steps: u32,
    pub step_size: u32,
    pub update: Update,
}

/// Where the field comes from; two equal plans give equal fields.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Plan {
    /// The parameter `field`.
    Given(Value),
    /// Drawn by the seed.
    Random(RandomField),
}

impl Settings {
    pub(super) fn read(parameters: &Parameters) -> Result<Self, ParameterError> {
        let read = ParameterReader::new(parameters);
        Ok(Self {
            steps: read.integer("steps", 1, MAX_STEPS)?.unwrap_or(50),
            step_size: read.integer("stepSize", 0, MAX_STEP_SIZE)?.unwrap_or(200),
            update: match read.choice("update", &["sequential", "simultaneous"])? {
                Some(1) => Update::Simultaneous,
                _ => Update::Sequential,
            },
        })
    }
}

/// The measures that parameters give, each absent or in range.
struct Measures {
    width: Option<u32>,
    height: Option<u32>,
    agents: Option<u32>,
    exits: Option<u32>,
    blockades: Option<u32>,
    seed: u64,
}

impl Measures {
    fn read(parameters: &Parameters) -> Result<Self, ParameterError> {
        let read = ParameterReader::new(parameters);
        Ok(Self {
            width: read.integer("width", 1, MAX_SIDE)?,
            height: read.integer("height", 1, MAX_SIDE)?,
            agents: read.integer("numAgents", 1, MAX_AGENTS)?,
            exits: read.integer("numExits", 1, MAX_CELLS)?,
            blockades: read.integer("numBlockades", 0, MAX_CELLS)?,
            seed: read.seed("seed")?.unwrap_or(0),
        })
    }
}

/// The field of these parameters, and where it came from. `previous` is used again where it is the same.
pub(super) fn read_field(
    parameters: &Parameters,
    previous: Option<(&Plan, &Field)>,
) -> Result<Option<(Plan, Field)>, ParameterError> {
    let measures = Measures::read(parameters)?;
    if let Some(value) = parameters.get("field") {
        if let Some((Plan::Given(same), field)) = previous
            && same == value
        {
            agree(&measures, field)?;
            return Ok(None);
        }
        let field = Field::read(value)?;
        agree(&measures, &field)?;
        return Ok(Some((Plan::Given(value.clone()), field)));
    }
    let random = RandomField {
        width: measures.width.unwrap_or(20),
        height: measures.height.unwrap_or(20),
        agents: measures.agents.unwrap_or(10),
        exits: measures.exits.unwrap_or(5),
        blockades: measures.blockades.unwrap_or(20),
        seed: measures.seed,
    };
    if let Some((Plan::Random(same), _)) = previous
        && *same == random
    {
        return Ok(None);
    }
    check_room(&random)?;
    Ok(Some((Plan::Random(random), Field::random(random))))
}

/// A measure that stands beside a field must be the field's.
fn agree(measures: &Measures, field: &Field) -> Result<(), ParameterError> {
    for (name, value, actual) in [
        ("width", measures.width, field.width as usize),
        ("height", measures.height, field.height as usize),
        ("numAgents", measures.agents, field.agents.len()),
        ("numExits", measures.exits, field.exits.len()),
        ("numBlockades", measures.blockades, field.blockades.len()),
    ] {
        if let Some(value) = value
            && value as usize != actual
        {
            return Err(wrong(
                name,
                format!(
                    "{value} found, but the field has {actual}; make them agree or leave {name} out"
                ),
            ));
        }
    }
    Ok(())
}

fn check_room(random: &RandomField) -> Result<(), ParameterError> {
    let RandomField {
        width,
        height,
        agents,
        exits,
        blockades,
        ..
    } = *random;
    let most = width.max(height);
    if agents > most {
        return Err(wrong(
            "numAgents",
            format!(
                "{agents} found, but a random field of {width} x {height} cells has at most {most} agents, the larger \
                 of width and height; make it larger or give a field"
            ),
        ));
    }
    let needed = u64::from(agents) + u64::from(exits) + u64::from(blockades);
    let cells = u64::from(width) * u64::from(width);
    if needed > cells {
        return Err(wrong(
            "width",
            format!(
                "{width} found, but numAgents, numExits and numBlockades need {needed} cells, and a random field has width x \
                 width = {cells}; make it wider or reduce them"
            ),
        ));
    }
    Ok(())
}

/// Every parameter, in the order of the documentation.
pub(super) fn parameters() -> Vec<ParameterInfo> {
    [
        (
            "steps",
            "integer",
            json!(50),
            "Steps after which the episode ends, 1 to 10000000.",
        ),
        (
            "width",
            "integer",
            json!(20),
            "Columns of a random field, 1 to 2000; a given field says so itself.",
        ),
        (
            "height",
            "integer",
            json!(20),
            "Rows of a random field, 1 to 2000. As in FREVO, rows are drawn from 0 to width - 1, whatever the height: take a square field.",
        ),
        (
            "field",
            "object",
            Value::Null,
            "Where everything is: {width, height, agents, exits, blockades}, the last three lists of cells [x, y], [0, 0] \
             top-left; in an experiment file also the path of a JSON file that holds it. Left out: a random field.",
        ),
        (
            "numAgents",
            "integer",
            json!(10),
            "Agents of a random field, 1 to the larger of width and height.",
        ),
        (
            "numExits",
            "integer",
            json!(5),
            "Exits of a random field, 1 to 4000000.",
        ),
        (
            "numBlockades",
            "integer",
            json!(20),
            "Blocked cells of a random field, 0 to 4000000; with exits and agents at most width * width.",
        ),
        (
            "seed",
            "integer",
            json!(0),
            "Seed of a random field; in experiments 0 to 2^62.",
        ),
        (
            "update",
            "string",
            json!("sequential"),
            "sequential: agents act one after another and see the moves already made, as in FREVO; simultaneous: all sense, then all move.",
        ),
        (
            "stepSize",
            "integer",
            json!(200),
            "Milliseconds between two frames when shown, 0 to 3600000.",
        ),
    ]
    .map(|(name, kind, default, description)| ParameterInfo {
        name,
        kind,
        default,
        description,
    })
    .into()
}
