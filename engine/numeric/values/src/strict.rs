//! Values of JSON for serde, which tell where an error is, and without serde's rule that a list of values can stand for an object
//! with fields.
//!
//! `serde_path_to_error` around serde_json's values does the same, but has the code of each type compiled some twenty times, for as
//! many generic readers. Here are one of each kind: the compiler needs a third of the time for a crate that reads large documents.

use std::fmt::{self, Display};

use serde::de::value::BorrowedStrDeserializer;
use serde::de::{
    self, DeserializeSeed, EnumAccess, Error as _, Expected, MapAccess, SeqAccess, Unexpected,
    VariantAccess, Visitor,
};
use serde::{Deserializer, forward_to_deserialize_any};
use serde_json::map::Iter as Fields;
use serde_json::{Map, Number, Value};

/// A part of a path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Segment {
    /// An item of a list.
    Item(usize),
    /// A field of an object.
    Field(String),
}

/// What does not fit, for deserializers that tell where it is.
#[derive(Debug)]
pub struct Error {
    pub(crate) reason: String,
    /// Its path, the innermost part first.
    pub(crate) path: Vec<Segment>,
}

impl Error {
    /// The error of a value that has a wrong part there.
    #[must_use]
    pub fn inside(mut self, segment: Segment) -> Self {
        self.path.push(segment);
        self
    }

    fn in_field(self, key: &str) -> Self {
        self.inside(Segment::Field(key.to_owned()))
    }
}

impl Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.reason)
    }
}

impl std::error::Error for Error {}

/// The found value, in terms of JSON.
struct ActualValue<'a>(Unexpected<'a>);

impl Display for ActualValue<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Unexpected::Unit => f.write_str("null"),
            Unexpected::Float(value) => match Number::from_f64(value) {
                Some(number) => write!(f, "floating point `{number}`"),
                None => self.0.fmt(f),
            },
            other => other.fmt(f),
        }
    }
}

impl de::Error for Error {
    fn custom<T: Display>(message: T) -> Self {
        Self {
            reason: message.to_string(),
            path: Vec::new(),
        }
    }

    fn invalid_type(actual: Unexpected<'_>, expected: &dyn Expected) -> Self {
        let actual = ActualValue(actual);
        Self::custom(format_args!("invalid type: {actual}, expected {expected}"))
    }

    fn invalid_value(actual: Unexpected<'_>, expected: &dyn Expected) -> Self {
        let actual = ActualValue(actual);
        Self::custom(format_args!("invalid value: {actual}, expected {expected}"))
    }
}

/// Methods for types that have no items and no fields: code that reads those is not compiled for them.
macro_rules! single {
    ($($method:ident)*) => {
        $(fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
            visit_single(self.0, visitor)
        })*
    };
}

/// As `&Value`, but that fields are read from objects alone.
pub(crate) struct Strict<'de>(pub(crate) &'de Value);

impl<'de> Deserializer<'de> for Strict<'de> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Array(items) => visit_items(items, visitor),
            Value::Object(fields) => visit_fields(fields, visitor),
            single => visit_single(single, visitor),
        }
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Array(items) => visit_items(items, visitor),
            other => visit_single(other, visitor),
        }
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, Error> {
        self.deserialize_seq(visitor)
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: usize,
        visitor: V,
    ) -> Result<V::Value, Error> {
        self.deserialize_seq(visitor)
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Object(fields) => visit_fields(fields, visitor),
            other => visit_single(other, visitor),
        }
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        self.deserialize_map(visitor)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Null => visitor.visit_none(),
            _ => visitor.visit_some(self),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        let (kind, value) = match self.0 {
            Value::String(kind) => (kind, None),
            Value::Object(fields) => {
                let mut fields = fields.iter();
                let (Some((kind, value)), None) = (fields.next(), fields.next()) else {
                    let expected = &"map with a single key";
                    return Err(Error::invalid_value(Unexpected::Map, expected));
                };
                (kind, Some(value))
            }
            other => return Err(Error::invalid_type(unexpected(other), &"string or map")),
        };
        visitor.visit_enum(Variant { kind, value })
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_unit()
    }

    single! {
        deserialize_bool deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64 deserialize_u8 deserialize_u16 deserialize_u32
        deserialize_u64 deserialize_f32 deserialize_f64 deserialize_char deserialize_str deserialize_string deserialize_identifier
        deserialize_unit
    }

    forward_to_deserialize_any! { i128 u128 bytes byte_buf unit_struct }
}

fn visit_items<'de, V: Visitor<'de>>(items: &'de [Value], visitor: V) -> Result<V::Value, Error> {
    let mut left = Items(items.iter().enumerate());
    let result = visitor.visit_seq(&mut left)?;
    let count = items.len() - left.0.len();
    complete(items.len(), count, "sequence").map(|()| result)
}

fn visit_fields<'de, V: Visitor<'de>>(
    fields: &'de Map<String, Value>,
    visitor: V,
) -> Result<V::Value, Error> {
    let mut left = Entries::of(fields);
    let result = visitor.visit_map(&mut left)?;
    let count = fields.len() - left.fields.len();
    complete(fields.len(), count, "map").map(|()| result)
}

/// A value that is no list and no object, or the error that it is one.
fn visit_single<'de, V: Visitor<'de>>(value: &'de Value, visitor: V) -> Result<V::Value, Error> {
    match value {
        Value::Null => visitor.visit_unit(),
        Value::Bool(value) => visitor.visit_bool(*value),
        Value::Number(number) => visit_number(number, visitor),
        Value::String(text) => visitor.visit_borrowed_str(text),
        Value::Array(_) | Value::Object(_) => Err(Error::invalid_type(unexpected(value), &visitor)),
    }
}

fn visit_number<'de, V: Visitor<'de>>(number: &Number, visitor: V) -> Result<V::Value, Error> {
    if let Some(value) = number.as_u64() {
        visitor.visit_u64(value)
    } else if let Some(value) = number.as_i64() {
        visitor.visit_i64(value)
    } else {
        visitor.visit_f64(number.as_f64().unwrap_or(f64::NAN))
    }
}

fn unexpected(value: &Value) -> Unexpected<'_> {
    match value {
        Value::Null => Unexpected::Unit,
        Value::Bool(value) => Unexpected::Bool(*value),
        Value::Number(number) => match (number.as_u64(), number.as_i64()) {
            (Some(value), _) => Unexpected::Unsigned(value),
            (None, Some(value)) => Unexpected::Signed(value),
            (None, None) => Unexpected::Float(number.as_f64().unwrap_or(f64::NAN)),
        },
        Value::String(text) => Unexpected::Str(text),
        Value::Array(_) => Unexpected::Seq,
        Value::Object(_) => Unexpected::Map,
    }
}

/// Whether a type has taken all that there is.
fn complete(length: usize, count: usize, noun: &str) -> Result<(), Error> {
    if length == count {
        return Ok(());
    }
    let elements = if count == 1 { "element" } else { "elements" };
    let expected = format!("{count} {elements} in {noun}");
    Err(Error::invalid_length(length, &expected.as_str()))
}

/// Items of a list.
struct Items<'de>(std::iter::Enumerate<std::slice::Iter<'de, Value>>);

impl<'de> SeqAccess<'de> for Items<'de> {
    type Error = Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, Error> {
        let Some((index, item)) = self.0.next() else {
            return Ok(None);
        };
        let item = seed.deserialize(Strict(item));
        item.map(Some)
            .map_err(|error| error.inside(Segment::Item(index)))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.0.len())
    }
}

/// Fields of an object.
struct Entries<'de> {
    fields: Fields<'de>,
    entry: Option<(&'de str, &'de Value)>,
}

impl<'de> Entries<'de> {
    fn of(fields: &'de Map<String, Value>) -> Self {
        Self {
            fields: fields.iter(),
            entry: None,
        }
    }
}

impl<'de> MapAccess<'de> for Entries<'de> {
    type Error = Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, Error> {
        let Some((key, value)) = self.fields.next() else {
            return Ok(None);
        };
        self.entry = Some((key, value));
        let result = seed.deserialize(BorrowedStrDeserializer::new(key));
        result.map(Some).map_err(|error: Error| error.in_field(key))
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, Error> {
        let Some((key, value)) = self.entry.take() else {
            return Err(Error::custom("a value was read before its key"));
        };
        let result = seed.deserialize(Strict(value));
        result.map_err(|error| error.in_field(key))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.fields.len())
    }
}

/// A variant of an enum, with values or without.
struct Variant<'de> {
    kind: &'de str,
    value: Option<&'de Value>,
}

impl<'de> EnumAccess<'de> for Variant<'de> {
    type Error = Error;
    type Variant = Self;

    fn variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<(T::Value, Self), Error> {
        let kind = seed.deserialize(BorrowedStrDeserializer::<Error>::new(self.kind))?;
        Ok((kind, self))
    }
}

impl<'de> Variant<'de> {
    /// What reads the values, or the error that there are none.
    fn values(&self, expected: &str) -> Result<Strict<'de>, Error> {
        let none = || Error::invalid_type(Unexpected::UnitVariant, &expected);
        self.value.map(Strict).ok_or_else(none)
    }
}

impl<'de> VariantAccess<'de> for Variant<'de> {
    type Error = Error;

    fn unit_variant(self) -> Result<(), Error> {
        let Some(value) = self.value else {
            return Ok(());
        };
        serde::Deserialize::deserialize(Strict(value))
            .map_err(|error: Error| error.in_field(self.kind))
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Error> {
        self.values("newtype variant")
            .and_then(|values| seed.deserialize(values))
            .map_err(|error| error.in_field(self.kind))
    }

    fn tuple_variant<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, Error> {
        self.values("tuple variant")
            .and_then(|values| values.deserialize_tuple(length, visitor))
            .map_err(|error| error.in_field(self.kind))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        self.values("struct variant")
            .and_then(|values| values.deserialize_struct("", fields, visitor))
            .map_err(|error| error.in_field(self.kind))
    }
}
