//! Specifications of machines with modules in Python.

use super::{Module, PythonModules};
use crate::SpecificationError;
use crate::kinds::{Kind, Modules};
use crate::reader::{Reader, wrong};

/// Behaviours, or conditions, at most.
const MOST_MODULES: usize = 256;

pub(super) fn read(reader: &mut Reader<'_>) -> Result<PythonModules, SpecificationError> {
    Ok(PythonModules {
        machine: Modules::read(reader)?,
        behaviours: modules(reader, "behaviours")?,
        conditions: modules(reader, "conditions")?,
    })
}

fn modules(reader: &mut Reader<'_>, field: &str) -> Result<Vec<Module>, SpecificationError> {
    let expected = "a list of modules such as {\"name\": \"spiral\", \"parameters\": {\"turn\": [1, 30, true]}}";
    let modules: Vec<Module> = reader.read(field, expected)?;
    if (1..=MOST_MODULES).contains(&modules.len()) {
        return Ok(modules);
    }
    Err(wrong(
        field,
        format!("{} found, expected 1 to {MOST_MODULES}", modules.len()),
    ))
}
