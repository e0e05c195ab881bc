//! Reads the fields of a specification one by one, so that every error names its field.

use crate::{Activation, OutputRange, SpecificationError};
use serde::de::DeserializeOwned;
use serde_json::Value;
use serde_json::value::RawValue;
use std::collections::BTreeMap;

type Fields<'a> = BTreeMap<String, &'a RawValue>;

/// The fields of a JSON object that have not been read yet.
pub(crate) struct Reader<'a> {
    fields: Fields<'a>,
    /// Names of the fields that were asked for, in this order.
    known: Vec<String>,
}

/// Raw text of a value, cut to a length that fits a message.
pub(crate) fn excerpt(raw: &RawValue) -> String {
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
            Ok(fields) => Ok(Self {
                fields,
                known: Vec::new(),
            }),
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
        self.known.push(field.to_owned());
        self.fields
            .remove(field)
            .ok_or_else(|| wrong(field, format!("is missing; expected {expected}")))
    }

    pub(crate) fn read<T: DeserializeOwned>(
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

    /// The place of a field's text among those allowed; the first one where the field is left out.
    pub(crate) fn choice(
        &mut self,
        field: &str,
        allowed: &[&str],
    ) -> Result<usize, SpecificationError> {
        let expected = format!("one of {}", allowed.join(", "));
        if !self.fields.contains_key(field) {
            self.known.push(field.to_owned());
            return Ok(0);
        }
        let text: String = self.read(field, &expected)?;
        let index = allowed.iter().position(|name| *name == text);
        index.ok_or_else(|| wrong(field, format!("{text:?} found, expected {expected}")))
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

    /// Lists of whole numbers from 0 to `highest`, which may depend on how many lists there are.
    pub(crate) fn lists(
        &mut self,
        field: &str,
        highest: impl Fn(usize) -> usize,
    ) -> Result<Vec<Vec<usize>>, SpecificationError> {
        let rows: Vec<Vec<Value>> = self.read(field, "a list of lists of whole numbers")?;
        let high = highest(rows.len());
        let number = |row: usize, index: usize, value: &Value| {
            whole(value, 0, high).ok_or_else(|| {
                wrong(
                    &format!("{field}[{row}][{index}]"),
                    format!("{value} found, expected a whole number from 0 to {high}"),
                )
            })
        };
        let each = rows.iter().enumerate().map(|(row, values)| {
            let each = values.iter().enumerate();
            each.map(|(index, value)| number(row, index, value))
                .collect()
        });
        each.collect()
    }

    pub(crate) fn activation(
        &mut self,
        allowed: &[Activation],
    ) -> Result<Activation, SpecificationError> {
        self.function("activation", allowed)
    }

    /// The function of the output layer; `None` where it is left out, and the one of all nodes applies.
    pub(crate) fn output_activation(
        &mut self,
        allowed: &[Activation],
    ) -> Result<Option<Activation>, SpecificationError> {
        let field = "output_activation";
        if !self.fields.contains_key(field) {
            self.known.push(field.to_owned());
            return Ok(None);
        }
        self.function(field, allowed).map(Some)
    }

    fn function(
        &mut self,
        field: &str,
        allowed: &[Activation],
    ) -> Result<Activation, SpecificationError> {
        let names: Vec<_> = allowed.iter().map(|a| a.name()).collect();
        let expected = format!("one of {}", names.join(", "));
        let text: String = self.read(field, &expected)?;
        let function = allowed.iter().copied().find(|a| a.name() == text);
        function.ok_or_else(|| wrong(field, format!("{text:?} found, expected {expected}")))
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

    /// Leaves the weights unread, for a reader of the architecture alone.
    pub(crate) fn skip_weights(&mut self) {
        self.known.push("weights".to_owned());
        self.fields.remove("weights");
    }

    /// Refuses the first field that was not asked for.
    pub(crate) fn end(self) -> Result<(), SpecificationError> {
        match self.fields.into_keys().next() {
            None => Ok(()),
            Some(field) => Err(wrong(
                &field,
                format!("is unknown; expected one of {}", self.known.join(", ")),
            )),
        }
    }
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
