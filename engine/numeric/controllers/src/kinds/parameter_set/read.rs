//! Specifications of parameter sets.

use super::{Parameter, ParameterKind, ParameterSet};
use crate::reader::{Reader, wrong};
use crate::{MAX_WEIGHTS, SpecificationError};
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeSet;

/// Keys of a parameters message that are not parameters, and the seed, which differs between episodes.
const RESERVED: [&str; 4] = ["server", "simulation", "simulation_hash", "seed"];

/// At least one parameter: a unique name, a type, and the choices of a categorical one.
pub(super) fn read(reader: &mut Reader<'_>) -> Result<ParameterSet, SpecificationError> {
    let expected = "a list of parameters such as {\"name\": \"range\", \"type\": \"real\"}";
    let items: Vec<Value> = reader.read("parameters", expected)?;
    if items.is_empty() || items.len() > MAX_WEIGHTS {
        return Err(wrong(
            "parameters",
            format!("{} found, expected 1 to {MAX_WEIGHTS}", items.len()),
        ));
    }
    let mut parameters: Vec<Parameter> = Vec::with_capacity(items.len());
    let mut names = BTreeSet::new();
    for (i, item) in items.iter().enumerate() {
        let complain = |reason: String| wrong(&format!("parameters[{i}]"), reason);
        let parameter = parameter(item).map_err(complain)?;
        if !names.insert(parameter.name.clone()) {
            return Err(complain(format!("{:?} is given twice", parameter.name)));
        }
        parameters.push(parameter);
    }
    Ok(ParameterSet { parameters })
}

/// A parameter of a parameter set, or what is wrong with it.
fn parameter(item: &Value) -> Result<Parameter, String> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Item {
        name: String,
        r#type: String,
        choices: Option<Vec<String>>,
    }
    let Item {
        name,
        r#type,
        choices,
    } = serde_json::from_value(item.clone()).map_err(|error| error.to_string())?;
    if name.is_empty() || RESERVED.contains(&name.as_str()) {
        return Err(format!(
            "{name:?} cannot be the name of a parameter in a set"
        ));
    }
    let kind = match (r#type.as_str(), choices) {
        ("real", None) => ParameterKind::Real,
        ("integer", None) => ParameterKind::Integer,
        ("categorical", Some(choices)) if !choices.is_empty() => {
            ParameterKind::Categorical { choices }
        }
        ("categorical", _) => return Err("choices: expected a list of texts".to_owned()),
        ("real" | "integer", Some(_)) => {
            return Err("choices: only allowed for the type categorical".to_owned());
        }
        _ => {
            return Err(format!(
                "type: {type:?} found, expected one of real, integer, categorical"
            ));
        }
    };
    Ok(Parameter { name, kind })
}
