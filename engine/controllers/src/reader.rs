//! Reads the fields of a specification one by one, so that every complaint names its field.

use crate::{Activation, OutputRange, Parameter, ParameterKind, SpecificationError};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use serde_json::value::RawValue;
use std::collections::{BTreeMap, BTreeSet};

type Fields<'a> = BTreeMap<String, &'a RawValue>;

/// The fields of a JSON object that have not been asked for yet.
pub(crate) struct Reader<'a> {
    fields: Fields<'a>,
}

/// Raw text of a value, cut to a length that fits a message.
fn excerpt(raw: &RawValue) -> String {
    let text = raw.get();
    if text.chars().count() <= 40 {
        text.to_owned()
    } else {
        text.chars().take(37).collect::<String>() + "..."
    }
}

pub(crate) fn wrong(field: &str, reason: impl Into<String>) -> SpecificationError {
    SpecificationError::Field {
        field: field.to_owned(),
        reason: reason.into(),
    }
}

impl<'a> Reader<'a> {
    pub(crate) fn new(text: &'a str) -> Result<Self, SpecificationError> {
        match serde_json::from_str::<Fields<'a>>(text) {
            Ok(fields) => Ok(Self { fields }),
            Err(e) if e.is_data() => Err(SpecificationError::NotAnObject),
            Err(e) => Err(SpecificationError::NotJson {
                line: e.line(),
                column: e.column(),
                reason: e.to_string(),
            }),
        }
    }

    /// Raw text of a field that must be there.
    pub(crate) fn raw(
        &mut self,
        field: &str,
        expected: &str,
    ) -> Result<&'a RawValue, SpecificationError> {
        self.fields
            .remove(field)
            .ok_or_else(|| wrong(field, format!("is missing; expected {expected}")))
    }

    fn read<T: DeserializeOwned>(
        &mut self,
        field: &str,
        expected: &str,
    ) -> Result<T, SpecificationError> {
        let raw = self.raw(field, expected)?;
        serde_json::from_str(raw.get()).map_err(|_| {
            wrong(
                field,
                format!("{} found, expected {expected}", excerpt(raw)),
            )
        })
    }

    pub(crate) fn text(
        &mut self,
        field: &str,
        expected: &str,
    ) -> Result<String, SpecificationError> {
        self.read(field, expected)
    }

    /// A whole number in `low..=high`; 8.0 counts as 8.
    pub(crate) fn count(
        &mut self,
        field: &str,
        low: usize,
        high: usize,
    ) -> Result<usize, SpecificationError> {
        let expected = if low == high {
            format!("{low}")
        } else {
            format!("a whole number from {low} to {high}")
        };
        let value: Value = self.read(field, &expected)?;
        whole(&value, low, high)
            .ok_or_else(|| wrong(field, format!("{value} found, expected {expected}")))
    }

    /// A list of whole numbers in `low..=high`.
    pub(crate) fn counts(
        &mut self,
        field: &str,
        low: usize,
        high: usize,
    ) -> Result<Vec<usize>, SpecificationError> {
        let expected = format!("a list of whole numbers from {low} to {high}");
        let values: Vec<Value> = self.read(field, &expected)?;
        let each = values.iter().enumerate().map(|(i, value)| {
            whole(value, low, high).ok_or_else(|| {
                wrong(
                    &format!("{field}[{i}]"),
                    format!("{value} found, expected a whole number from {low} to {high}"),
                )
            })
        });
        each.collect()
    }

    pub(crate) fn activation(
        &mut self,
        allowed: &[Activation],
    ) -> Result<Activation, SpecificationError> {
        let names: Vec<_> = allowed.iter().map(|a| a.name()).collect();
        let expected = format!("one of {}", names.join(", "));
        let found: String = self.read("activation", &expected)?;
        let known = allowed.iter().copied().find(|a| a.name() == found);
        known.ok_or_else(|| {
            wrong(
                "activation",
                format!("{found:?} found, expected {expected}"),
            )
        })
    }

    pub(crate) fn output_range(&mut self) -> Result<OutputRange, SpecificationError> {
        let expected = "[low, high] with low < high, such as [-1, 1] or [0, 1]";
        let raw = self.raw("output_range", expected)?;
        let pair: Option<[f32; 2]> = serde_json::from_str(raw.get()).ok();
        let range = pair.and_then(|[low, high]| OutputRange::new(low, high));
        range.ok_or_else(|| {
            wrong(
                "output_range",
                format!("{} found, expected {expected}", excerpt(raw)),
            )
        })
    }

    /// A list for each sensor, of finite binary32 numbers, ascending.
    pub(crate) fn thresholds(
        &mut self,
        sensors: usize,
    ) -> Result<Vec<Vec<f32>>, SpecificationError> {
        let expected =
            format!("a list of {sensors} lists of ascending numbers, such as [[-0.5, 0.5], [0]]");
        let raw = self.raw("thresholds", &expected)?;
        let found = || format!("{} found, expected {expected}", excerpt(raw));
        let thresholds: Vec<Vec<f32>> =
            serde_json::from_str(raw.get()).map_err(|_| wrong("thresholds", found()))?;
        if thresholds.len() != sensors {
            return Err(wrong("thresholds", found()));
        }
        let ascends = |of_one: &[f32]| of_one.windows(2).all(|pair| pair[0] < pair[1]);
        let sound = |of_one: &Vec<f32>| ascends(of_one) && of_one.iter().all(|t| t.is_finite());
        match thresholds.iter().position(|of_one| !sound(of_one)) {
            None => Ok(thresholds),
            Some(i) => Err(wrong(
                &format!("thresholds[{i}]"),
                "must hold finite binary32 numbers, each greater than the one before",
            )),
        }
    }

    /// At least one parameter: a name that no other has, a type, and the choices where there are any.
    pub(crate) fn parameters(&mut self, most: usize) -> Result<Vec<Parameter>, SpecificationError> {
        let expected = "a list of parameters such as {\"name\": \"range\", \"type\": \"real\"}";
        let items: Vec<Value> = self.read("parameters", expected)?;
        if items.is_empty() || items.len() > most {
            return Err(wrong(
                "parameters",
                format!("{} found, expected 1 to {most}", items.len()),
            ));
        }
        let mut parameters: Vec<Parameter> = Vec::with_capacity(items.len());
        let mut names = BTreeSet::new();
        for (i, item) in items.iter().enumerate() {
            let complain = |reason: String| wrong(&format!("parameters[{i}]"), reason);
            let parameter = parameter(item).map_err(complain)?;
            if !names.insert(parameter.name.clone()) {
                return Err(complain(format!("{:?} stands twice", parameter.name)));
            }
            parameters.push(parameter);
        }
        Ok(parameters)
    }

    /// Finite binary32 numbers.
    pub(crate) fn weights(&mut self, count: usize) -> Result<Vec<f32>, SpecificationError> {
        let expected = format!("a list of {count} numbers");
        let raw = self.raw("weights", &expected)?;
        let weights = serde_json::from_str::<Vec<f32>>(raw.get())
            .map_err(|_| first_bad_weight(raw, &expected))?;
        if let Some(i) = weights.iter().position(|w| !w.is_finite()) {
            return Err(wrong(
                &format!("weights[{i}]"),
                "must be a finite binary32 number",
            ));
        }
        if weights.len() != count {
            return Err(wrong(
                "weights",
                format!(
                    "{} numbers found, but this controller needs {count}",
                    weights.len()
                ),
            ));
        }
        Ok(weights)
    }

    /// Leaves the weights unread, for those who only ask about the architecture.
    pub(crate) fn skip_weights(&mut self) {
        self.fields.remove("weights");
    }

    /// Complains about the first field nobody asked for.
    pub(crate) fn end(self, known: &[&str]) -> Result<(), SpecificationError> {
        match self.fields.into_keys().next() {
            None => Ok(()),
            Some(field) => Err(wrong(
                &field,
                format!("is not known here; known are {}", known.join(", ")),
            )),
        }
    }
}

/// Keys of a parameters message that are no parameters, and the one that every episode has its own of.
const RESERVED: [&str; 4] = ["server", "simulation", "simulation_hash", "seed"];

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
        return Err(format!("{name:?} is no name of a parameter to be set"));
    }
    let kind = match (r#type.as_str(), choices) {
        ("real", None) => ParameterKind::Real,
        ("integer", None) => ParameterKind::Integer,
        ("categorical", Some(choices)) if !choices.is_empty() => {
            ParameterKind::Categorical { choices }
        }
        ("categorical", _) => return Err("choices: expected a list of texts".to_owned()),
        ("real" | "integer", Some(_)) => return Err("choices: only for categorical".to_owned()),
        _ => {
            return Err(format!(
                "type: {type:?} found, expected one of real, integer, categorical"
            ));
        }
    };
    Ok(Parameter { name, kind })
}

fn whole(value: &Value, low: usize, high: usize) -> Option<usize> {
    let number = value.as_f64().filter(|n| n.fract() == 0.0)?;
    // Limits are far below 2^53, so the comparison and the conversion are exact.
    (number >= low as f64 && number <= high as f64).then_some(number as usize)
}

fn first_bad_weight(raw: &RawValue, expected: &str) -> SpecificationError {
    let Ok(items) = serde_json::from_str::<Vec<&RawValue>>(raw.get()) else {
        return wrong(
            "weights",
            format!("{} found, expected {expected}", excerpt(raw)),
        );
    };
    let bad = items
        .iter()
        .enumerate()
        .find(|(_, item)| serde_json::from_str::<f32>(item.get()).is_err());
    match bad {
        Some((i, item)) => wrong(
            &format!("weights[{i}]"),
            format!("{} found, expected a finite binary32 number", excerpt(item)),
        ),
        None => wrong("weights", format!("expected {expected}")),
    }
}
