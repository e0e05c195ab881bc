//! Rewords serde's messages for invalid values, without names of Rust types.

use serde_json::Value;

use crate::suggestions::did_you_mean;

/// Characters of a value that are told, at most.
const MOST: usize = 40;

/// What was found, cut to a length that fits a message.
pub(crate) fn describe_value(value: &Value) -> String {
    let note = if value.is_string() { " (a string)" } else { "" };
    match value {
        Value::Object(_) => "an object found".to_owned(),
        Value::Array(_) => "a list found".to_owned(),
        value => format!("{}{note} found", cut(&value.to_string())),
    }
}

fn cut(text: &str) -> String {
    if text.chars().count() <= MOST {
        return text.to_owned();
    }
    text.chars().take(MOST - 3).collect::<String>() + "..."
}

/// What serde says, for those who do not know Rust: what was found, and what is expected; other words as they are.
#[must_use]
pub fn plain(words: &str) -> String {
    // Where it is read from a text.
    if let Some((inner, position)) = words.rsplit_once(" at line ") {
        let numbers = position.split_once(" column ");
        let is_number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
        if numbers.is_some_and(|(line, column)| is_number(line) && is_number(column)) {
            return format!("{}, at line {position}", translated(inner));
        }
    }
    translated(words)
}

fn translated(words: &str) -> String {
    let translated = || {
        let (first, rest) = words.split_once(' ')?;
        match first {
            "invalid" => invalid(rest),
            // unknown variant `a`, expected one of `b`, `c`
            "unknown" => {
                let (kind, rest) = rest.split_once(" `")?;
                let (name, expected) = rest.split_once("`, expected ")?;
                let hint = did_you_mean(name, expected.split('`').skip(1).step_by(2));
                match kind {
                    "variant" => {
                        let expected = expected.replace('`', "\"");
                        Some(format!("{name:?} found, expected {expected}{hint}"))
                    }
                    _ => Some(format!("{words}{hint}")),
                }
            }
            _ => None,
        }
    };
    translated().unwrap_or_else(|| words.to_owned())
}

/// `type: string "a", expected f32` and the like.
fn invalid(words: &str) -> Option<String> {
    let (of, rest) = words.split_once(' ')?;
    let (unexpected, expected) = rest.rsplit_once(", expected ")?;
    let expected = expected_words(expected);
    match of {
        "type:" | "value:" => Some(format!(
            "{} found, expected {expected}",
            unexpected_words(unexpected)
        )),
        "length" if expected == "an object" => Some(format!("a list found, expected {expected}")),
        "length" => Some(format!("{} found, expected {expected}", items(unexpected))),
        _ => None,
    }
}

/// Formats a number of entries of a list.
fn items(count: &str) -> String {
    let noun = if count == "1" { "item" } else { "items" };
    format!("{count} {noun}")
}

/// What serde calls what it found.
fn unexpected_words(words: &str) -> String {
    let quoted = |kind: &str| {
        words
            .strip_prefix(kind)?
            .strip_prefix(" `")?
            .strip_suffix('`')
    };
    let number = ["boolean", "integer", "floating point", "character"]
        .into_iter()
        .find_map(quoted);
    match (number, words) {
        (Some(number), _) => number.to_owned(),
        (_, "map") => "an object".to_owned(),
        (_, "sequence") => "a list".to_owned(),
        (_, "unit" | "null" | "Option value") => "null".to_owned(),
        (_, words) => match words.strip_prefix("string ") {
            Some(text) => format!("{} (a string)", cut(text)),
            None => words.to_owned(),
        },
    }
}

/// What serde calls what it expects.
fn expected_words(words: &str) -> String {
    let (kind, name) = words.split_once(' ').unwrap_or((words, ""));
    let text = match kind {
        "f32" | "f64" => "a number",
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number of at least 0",
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number",
        "struct" | "map" => "an object",
        "unit" => "null",
        _ => match words {
            "a boolean" => "true or false",
            "a map" => "an object",
            "a sequence" => "a list",
            "string or map" | "variant identifier" => "a name",
            _ => {
                let size = words
                    .strip_prefix("an array of length ")
                    .or_else(|| words.strip_prefix("an array of size "))
                    .or_else(|| words.strip_suffix(" elements in sequence"))
                    .or_else(|| {
                        (kind == "tuple")
                            .then(|| name.strip_prefix("of size "))
                            .flatten()
                    });
                return match size {
                    Some(size) => format!("a list of {size}"),
                    None => words.to_owned(),
                };
            }
        },
    };
    // "struct Walls with 3 elements" says nothing more to those who write objects.
    text.to_owned()
}
