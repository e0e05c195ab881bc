//! Where agents, exits and blockades are at the start.

use super::random::JavaRandom;
use super::settings::{MAX_AGENTS, MAX_SIDE};
use crate::parameters::wrong;
use crate::{ParameterError, ParameterReader, Parameters};
use serde_json::{Map, Value};

/// Column and row of a cell, [0, 0] top-left.
pub(super) type Cell = [u32; 2];

/// Where everything is at the start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Field {
    pub width: u32,
    pub height: u32,
    /// Rows in use. FREVO draws rows like columns, below `width`: in a random field that is wider than high there may be
    /// something below its last row.
    pub rows: u32,
    pub agents: Vec<Cell>,
    pub exits: Vec<Cell>,
    pub blockades: Vec<Cell>,
}

/// Measures of a random field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RandomField {
    pub width: u32,
    pub height: u32,
    pub agents: u32,
    pub exits: u32,
    pub blockades: u32,
    pub seed: u64,
}

const KEYS: [&str; 5] = ["width", "height", "agents", "exits", "blockades"];

impl Field {
    /// Reads the object of the parameter `field`.
    pub(super) fn read(value: &Value) -> Result<Self, ParameterError> {
        let object = value.as_object().ok_or_else(|| not_an_object(value))?;
        if let Some(key) = object.keys().find(|key| !KEYS.contains(&key.as_str())) {
            return Err(wrong(
                "field",
                format!("unknown key \"{key}\"; known keys: {}", KEYS.join(", ")),
            ));
        }
        let read = ParameterReader::new(object);
        let side = |name| {
            let side = read.integer(name, 1, MAX_SIDE).map_err(inside)?;
            side.ok_or_else(|| wrong(&format!("field.{name}"), "is missing"))
        };
        let (width, height) = (side("width")?, side("height")?);
        let cells = |name, limit| cells(object, name, limit, [width, height]);
        let many = width * height;
        let field = Self {
            width,
            height,
            rows: height,
            agents: cells("agents", MAX_AGENTS)?,
            exits: cells("exits", many)?,
            blockades: cells("blockades", many)?,
        };
        field.check()?;
        Ok(field)
    }

    fn check(&self) -> Result<(), ParameterError> {
        for (name, cells) in [("agents", &self.agents), ("exits", &self.exits)] {
            if cells.is_empty() {
                return Err(wrong(
                    &format!("field.{name}"),
                    "at least one cell [x, y] is needed",
                ));
            }
        }
        let mut map = self.map();
        for [x, y] in &self.blockades {
            map.put([*x, *y]);
        }
        for (name, cells, stay) in [
            ("exits", &self.exits, false),
            ("agents", &self.agents, true),
        ] {
            for (i, cell) in cells.iter().enumerate() {
                if map.holds(*cell) {
                    let [x, y] = cell;
                    let occupant = if self.blockades.contains(cell) {
                        "a blockade stands"
                    } else {
                        "another agent stands"
                    };
                    return Err(wrong(
                        &format!("field.{name}[{i}]"),
                        format!("[{x}, {y}] found, where {occupant}; choose another cell"),
                    ));
                }
                if stay {
                    map.put(*cell);
                }
            }
        }
        Ok(())
    }

    /// FREVO's random field: agents, then exits, then blockades, each drawn until it has a cell of its own.
    ///
    /// There must be cells enough, see `RandomField`.
    pub(super) fn random(measures: RandomField) -> Self {
        let RandomField { width, height, .. } = measures;
        let mut field = Self {
            width,
            height,
            rows: height.max(width),
            agents: Vec::new(),
            exits: Vec::new(),
            blockades: Vec::new(),
        };
        let mut map = field.map();
        let mut random = JavaRandom::new(measures.seed);
        let mut draw = |count| {
            let mut draw_cell = || loop {
                let x = random.below(width);
                // Not the height: that is how FREVO draws.
                let y = random.below(width);
                if !map.holds([x, y]) {
                    map.put([x, y]);
                    return [x, y];
                }
            };
            (0..count).map(|_| draw_cell()).collect()
        };
        field.agents = draw(measures.agents);
        field.exits = draw(measures.exits);
        field.blockades = draw(measures.blockades);
        let lists = [&field.agents, &field.exits, &field.blockades];
        let lowest = lists.into_iter().flatten().map(|[_, y]| y + 1).max();
        field.rows = height.max(lowest.unwrap_or(0));
        field
    }

    fn map(&self) -> Occupied {
        Occupied {
            width: self.width,
            cells: vec![false; self.width as usize * self.rows as usize],
        }
    }
}

/// Which cells are taken.
struct Occupied {
    width: u32,
    cells: Vec<bool>,
}

impl Occupied {
    fn index(&self, [x, y]: Cell) -> usize {
        y as usize * self.width as usize + x as usize
    }

    fn holds(&self, cell: Cell) -> bool {
        self.cells[self.index(cell)]
    }

    fn put(&mut self, cell: Cell) {
        let index = self.index(cell);
        self.cells[index] = true;
    }
}

fn not_an_object(value: &Value) -> ParameterError {
    let reason = match value {
        Value::String(path) => format!(
            "\"{path}\" found, but the simulation reads no files; name the file in an experiment file, or pass an object \
             {{\"width\", \"height\", \"agents\", \"exits\", \"blockades\"}}"
        ),
        _ => "expected an object {\"width\", \"height\", \"agents\", \"exits\", \"blockades\"}"
            .to_owned(),
    };
    wrong("field", reason)
}

/// A complaint about a key of the field.
fn inside(error: ParameterError) -> ParameterError {
    wrong(&format!("field.{}", error.name), error.reason)
}

fn cells(
    object: &Map<String, Value>,
    name: &str,
    limit: u32,
    [width, height]: [u32; 2],
) -> Result<Vec<Cell>, ParameterError> {
    // Cells are whole numbers below 2^24, exact in binary32.
    let last = [(width - 1) as f32, (height - 1) as f32];
    let positions = Parameters::from_iter([(
        name.to_owned(),
        object
            .get(name)
            .cloned()
            .unwrap_or_else(|| Value::Array(Vec::new())),
    )]);
    let positions = ParameterReader::new(&positions)
        .positions(name, limit, last)
        .map_err(inside)?
        .unwrap_or_default();
    let cell = |(i, [x, y]): (usize, [f32; 2])| {
        if x.fract() == 0.0 && y.fract() == 0.0 {
            Ok([x as u32, y as u32])
        } else {
            Err(wrong(
                &format!("field.{name}[{i}]"),
                format!("[{x}, {y}] found, expected column and row of a cell, two whole numbers"),
            ))
        }
    };
    positions.into_iter().enumerate().map(cell).collect()
}
