//! Values of JSON's kinds between Rust and Python: dicts, lists, text, numbers, booleans, None.
//!
//! pythonize does this for other versions of PyO3 than ours; and it takes NaN for null, where the input is wrong.

use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Number, Value};

use crate::errors::{engine, input};

/// Levels of lists and dicts in each other, as many as serde_json reads.
const MAX_DEPTH: usize = 127;

/// What serde writes, as Python's values. Numbers that are not finite become None.
pub fn to_python<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    python(py, &serde_json::to_value(value).map_err(engine)?)
}

fn python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Null => py.None().into_bound(py),
        Value::Bool(value) => PyBool::new(py, *value).to_owned().into_any(),
        Value::Number(number) => self::number(py, number)?,
        Value::String(text) => PyString::new(py, text).into_any(),
        Value::Array(items) => {
            let list = PyList::empty(py);
            for item in items {
                list.append(python(py, item)?)?;
            }
            list.into_any()
        }
        Value::Object(fields) => dict(py, fields)?.into_any(),
    })
}

/// An object as a dict, in the object's order.
pub fn dict<'py>(py: Python<'py>, fields: &Map<String, Value>) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (name, value) in fields {
        dict.set_item(name, python(py, value)?)?;
    }
    Ok(dict)
}

fn number<'py>(py: Python<'py>, number: &Number) -> PyResult<Bound<'py, PyAny>> {
    Ok(if let Some(integer) = number.as_i64() {
        integer.into_pyobject(py)?.into_any()
    } else if let Some(integer) = number.as_u64() {
        integer.into_pyobject(py)?.into_any()
    } else {
        let float = number.as_f64().unwrap_or(f64::NAN);
        float.into_pyobject(py)?.into_any()
    })
}

/// A dict from Python; `name` is what messages begin with.
///
/// # Errors
/// `InputError` naming the place of a value that JSON cannot hold: a number that is not finite, another type.
pub fn object(name: &str, dict: &Bound<'_, PyDict>) -> PyResult<Map<String, Value>> {
    fields(dict, 0).map_err(|wrong| input(format!("{name}{}: {}", wrong.place, wrong.reason)))
}

/// A value from Python, see [`object`].
pub fn read<T: DeserializeOwned>(name: &str, value: &Bound<'_, PyAny>) -> PyResult<T> {
    let value =
        any(value, 0).map_err(|wrong| input(format!("{name}{}: {}", wrong.place, wrong.reason)))?;
    swarmwright_values::read(&value)
        .map_err(|mismatch| input(format!("{}: {}", mismatch.path_in(name), mismatch.reason)))
}

/// Why a value cannot be taken, and where it is in the whole.
struct Wrong {
    place: String,
    reason: String,
}

impl Wrong {
    fn new(reason: impl Into<String>) -> Self {
        Self {
            place: String::new(),
            reason: reason.into(),
        }
    }

    fn within(mut self, location: &str) -> Self {
        self.place.insert_str(0, location);
        self
    }
}

fn any(value: &Bound<'_, PyAny>, depth: usize) -> Result<Value, Wrong> {
    if value.is_none() {
        Ok(Value::Null)
    } else if let Ok(value) = value.cast::<PyBool>() {
        Ok(value.is_true().into())
    } else if let Ok(value) = value.cast::<PyInt>() {
        integer(value)
    } else if let Ok(value) = value.cast::<PyFloat>() {
        finite(value.value())
    } else if let Ok(text) = value.cast::<PyString>() {
        self::text(text).map(Value::String)
    } else if let Ok(dict) = value.cast::<PyDict>() {
        fields(dict, depth).map(Value::Object)
    } else if let Ok(list) = value.cast::<PyList>() {
        items(list.iter(), depth)
    } else if let Ok(tuple) = value.cast::<PyTuple>() {
        items(tuple.iter(), depth)
    } else {
        let kind = value.get_type();
        let kind = kind.name().map(|name| name.to_string());
        Err(Wrong::new(format!(
            "a {} found, expected text, a number, a boolean, None, a list or a dict",
            kind.unwrap_or_default()
        )))
    }
}

fn integer(value: &Bound<'_, PyInt>) -> Result<Value, Wrong> {
    if let Ok(value) = value.extract::<i64>() {
        Ok(value.into())
    } else if let Ok(value) = value.extract::<u64>() {
        Ok(value.into())
    } else {
        // As JSON with so many digits is read.
        finite(value.extract().unwrap_or(f64::INFINITY))
    }
}

fn finite(value: f64) -> Result<Value, Wrong> {
    Number::from_f64(value)
        .map(Value::Number)
        .ok_or_else(|| Wrong::new(format!("{value} found, expected a finite number")))
}

fn text(text: &Bound<'_, PyString>) -> Result<String, Wrong> {
    let text = text.to_str();
    text.map(str::to_owned)
        .map_err(|_| Wrong::new("text that cannot be encoded as UTF-8"))
}

fn fields(dict: &Bound<'_, PyDict>, depth: usize) -> Result<Map<String, Value>, Wrong> {
    let depth = below(depth)?;
    let mut fields = Map::new();
    for (key, value) in dict.iter() {
        let name = self::key(&key)?;
        let value = any(&value, depth).map_err(|wrong| wrong.within(&format!(".{name}")))?;
        fields.insert(name, value);
    }
    Ok(fields)
}

/// Names that are numbers, booleans or None become text, as in Python's own module json.
fn key(key: &Bound<'_, PyAny>) -> Result<String, Wrong> {
    match any(key, MAX_DEPTH)? {
        Value::String(name) => Ok(name),
        other => Ok(other.to_string()),
    }
}

fn items<'py>(
    items: impl Iterator<Item = Bound<'py, PyAny>>,
    depth: usize,
) -> Result<Value, Wrong> {
    let depth = below(depth)?;
    let each = |(index, item): (usize, Bound<'py, PyAny>)| {
        any(&item, depth).map_err(|wrong| wrong.within(&format!("[{index}]")))
    };
    items.enumerate().map(each).collect()
}

fn below(depth: usize) -> Result<usize, Wrong> {
    if depth < MAX_DEPTH {
        Ok(depth + 1)
    } else {
        Err(Wrong::new("is nested too deeply"))
    }
}
