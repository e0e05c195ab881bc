//! Reads parameters with complaints that name the parameter, what was found and what is expected.

use crate::{ParameterError, Parameters};
use serde_json::Value;

/// Typed access to the parameters of a message. Absent parameters give None.
#[derive(Debug, Clone, Copy)]
pub struct ParameterReader<'a>(&'a Parameters);

/// A complaint about one parameter.
pub fn wrong(name: &str, reason: impl Into<String>) -> ParameterError {
    ParameterError {
        name: name.to_owned(),
        reason: reason.into(),
    }
}

/// What was found, cut to a length that fits a message.
fn found(value: &Value) -> String {
    let text = value.to_string();
    let short = if text.chars().count() <= 40 {
        text
    } else {
        text.chars().take(37).collect::<String>() + "..."
    };
    let note = if value.is_string() { " (a string)" } else { "" };
    format!("{short}{note} found")
}

fn mismatch(name: &str, value: &Value, expected: &str) -> ParameterError {
    wrong(name, format!("{}, expected {expected}", found(value)))
}

/// A number as binary32, rounded from binary64; None if it is not a number or out of range.
fn single(value: &Value) -> Option<f32> {
    value.as_f64().map(|n| n as f32).filter(|n| n.is_finite())
}

/// The numbers that are expected, in words.
fn within<T: Into<f64> + std::fmt::Display>(low: T, high: T) -> String {
    let text = [low.to_string(), high.to_string()];
    match (low.into().is_finite(), high.into().is_finite()) {
        (true, true) => format!("a number from {} to {}", text[0], text[1]),
        (true, false) => format!("a finite number of at least {}", text[0]),
        (false, true) => format!("a finite number of at most {}", text[1]),
        (false, false) => "a finite number".to_owned(),
    }
}

/// A whole number, 13.0 included.
fn whole(value: &Value) -> Option<i128> {
    let integer = value
        .as_i64()
        .map(i128::from)
        .or_else(|| value.as_u64().map(i128::from));
    // Within 2^53 the conversion of a whole binary64 is exact.
    let fraction = || {
        value
            .as_f64()
            .filter(|n| n.fract() == 0.0 && n.abs() <= 9_007_199_254_740_992.0)
    };
    integer.or_else(|| fraction().map(|n| n as i128))
}

impl<'a> ParameterReader<'a> {
    /// Reads from the parameters of a message.
    pub fn new(parameters: &'a Parameters) -> Self {
        Self(parameters)
    }

    fn get(self, name: &str) -> Option<&'a Value> {
        self.0.get(name)
    }

    /// A whole number in `low..=high`; 13.0 counts as 13.
    ///
    /// # Errors
    /// Anything else, a number in a string included.
    pub fn integer(self, name: &str, low: u32, high: u32) -> Result<Option<u32>, ParameterError> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        let number = whole(value).filter(|n| (i128::from(low)..=i128::from(high)).contains(n));
        match number.and_then(|n| u32::try_from(n).ok()) {
            Some(number) => Ok(Some(number)),
            None => Err(mismatch(
                name,
                value,
                &format!("a whole number from {low} to {high}"),
            )),
        }
    }

    /// A whole number in `low..=high`, for those beyond [`integer`](Self::integer).
    ///
    /// # Errors
    /// Anything else.
    pub fn whole(self, name: &str, low: i64, high: i64) -> Result<Option<i64>, ParameterError> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        whole(value)
            .and_then(|n| i64::try_from(n).ok())
            .filter(|n| (low..=high).contains(n))
            .map(Some)
            .ok_or_else(|| mismatch(name, value, &format!("a whole number from {low} to {high}")))
    }

    /// A finite number in `low..=high`; an infinite bound is none.
    ///
    /// # Errors
    /// Anything else.
    pub fn number(self, name: &str, low: f64, high: f64) -> Result<Option<f64>, ParameterError> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        value
            .as_f64()
            .filter(|n| n.is_finite() && (low..=high).contains(n))
            .map(Some)
            .ok_or_else(|| mismatch(name, value, &within(low, high)))
    }

    /// A finite number in `low..=high` once it is rounded to binary32; an infinite bound is none.
    ///
    /// # Errors
    /// Anything else.
    pub fn single(self, name: &str, low: f32, high: f32) -> Result<Option<f32>, ParameterError> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        single(value)
            .filter(|n| (low..=high).contains(n))
            .map(Some)
            .ok_or_else(|| mismatch(name, value, &within(low, high)))
    }

    /// A list of `least..=most` finite numbers, each in `low..=high`; an infinite bound is none.
    ///
    /// # Errors
    /// Anything else.
    pub fn numbers(
        self,
        name: &str,
        count: std::ops::RangeInclusive<usize>,
        low: f64,
        high: f64,
    ) -> Result<Option<Vec<f64>>, ParameterError> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        let Some(items) = value.as_array() else {
            return Err(mismatch(name, value, "a list of numbers"));
        };
        if !count.contains(&items.len()) {
            let (least, most) = count.into_inner();
            let expected = match (least, most) {
                (least, most) if least == most => least.to_string(),
                (least, usize::MAX) => format!("at least {least}"),
                (0, most) => format!("at most {most}"),
                (least, most) => format!("{least} to {most}"),
            };
            return Err(wrong(
                name,
                format!("{} numbers found, expected {expected}", items.len()),
            ));
        }
        let each = items.iter().enumerate().map(|(i, item)| {
            item.as_f64()
                .filter(|n| n.is_finite() && (low..=high).contains(n))
                .ok_or_else(|| mismatch(&format!("{name}[{i}]"), item, &within(low, high)))
        });
        each.collect::<Result<_, _>>().map(Some)
    }

    /// True or false.
    ///
    /// # Errors
    /// Anything else, 0 and 1 included.
    pub fn flag(self, name: &str) -> Result<Option<bool>, ParameterError> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        value
            .as_bool()
            .map(Some)
            .ok_or_else(|| mismatch(name, value, "true or false"))
    }

    /// A seed: any whole number of 64 bits; a negative one stands for its two's complement.
    ///
    /// # Errors
    /// Anything else.
    pub fn seed(self, name: &str) -> Result<Option<u64>, ParameterError> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        let number = whole(value);
        let bits = number.and_then(|n| {
            u64::try_from(n)
                .ok()
                .or_else(|| i64::try_from(n).ok().map(i64::cast_unsigned))
        });
        bits.map(Some)
            .ok_or_else(|| mismatch(name, value, "a whole number of at most 64 bits"))
    }

    /// A finite number of at least 0, rounded to binary32.
    ///
    /// # Errors
    /// Anything else.
    pub fn not_negative(self, name: &str) -> Result<Option<f32>, ParameterError> {
        self.single(name, 0.0, f32::INFINITY)
    }

    /// A string.
    ///
    /// # Errors
    /// Anything else.
    pub fn text(self, name: &str) -> Result<Option<&'a str>, ParameterError> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        value
            .as_str()
            .map(Some)
            .ok_or_else(|| mismatch(name, value, "a string"))
    }

    /// One of `choices`, as its index.
    ///
    /// # Errors
    /// Anything else.
    pub fn choice(self, name: &str, choices: &[&str]) -> Result<Option<usize>, ParameterError> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        let index = value
            .as_str()
            .and_then(|text| choices.iter().position(|c| *c == text));
        let expected = || format!("one of \"{}\"", choices.join("\", \""));
        index
            .map(Some)
            .ok_or_else(|| mismatch(name, value, &expected()))
    }

    /// A position [x, y] inside the map, borders included.
    ///
    /// # Errors
    /// Anything else.
    pub fn position(self, name: &str, map: [f32; 2]) -> Result<Option<[f32; 2]>, ParameterError> {
        self.get(name)
            .map(|value| position(name, value, map))
            .transpose()
    }

    /// A list of at most `limit` positions [[x, y], ..] inside the map, borders included.
    ///
    /// # Errors
    /// Anything else.
    pub fn positions(
        self,
        name: &str,
        limit: u32,
        map: [f32; 2],
    ) -> Result<Option<Vec<[f32; 2]>>, ParameterError> {
        let Some(value) = self.get(name) else {
            return Ok(None);
        };
        let Some(items) = value.as_array() else {
            return Err(mismatch(name, value, "a list of positions [[x, y], ..]"));
        };
        if items.len() > limit as usize {
            return Err(wrong(
                name,
                format!(
                    "{} positions found, at most {limit} are possible",
                    items.len()
                ),
            ));
        }
        let each = items
            .iter()
            .enumerate()
            .map(|(i, item)| position(&format!("{name}[{i}]"), item, map));
        each.collect::<Result<_, _>>().map(Some)
    }
}

fn position(name: &str, value: &Value, map: [f32; 2]) -> Result<[f32; 2], ParameterError> {
    let pair = match value.as_array().map(Vec::as_slice) {
        Some([x, y]) => single(x).zip(single(y)),
        _ => None,
    };
    let Some((x, y)) = pair else {
        return Err(mismatch(name, value, "a position [x, y] of two numbers"));
    };
    let inside = (0.0..=map[0]).contains(&x) && (0.0..=map[1]).contains(&y);
    let expected = || {
        format!(
            "a position inside the map, [0, 0] to [{}, {}]",
            map[0], map[1]
        )
    };
    if inside {
        Ok([x, y])
    } else {
        Err(mismatch(name, value, &expected()))
    }
}
