//! Values of arbitrary shape within a message. Their number is limited, since one byte of a message can encode a value,
//! but a value takes many bytes of memory.

use std::cell::Cell;
use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};

/// Largest total weight of the values of a key, in units of about [`UNIT`] bytes.
pub(crate) const MOST_WEIGHT: usize = 4 << 20;
/// Bytes of memory per unit of weight.
const UNIT: usize = 32;
/// Weight of a list in addition to its items, since it reserves more memory for its first items than they need.
const LIST: usize = 4;
/// Weight of a map in addition to its entries, since it consists of nodes for eleven entries.
const MAP: usize = 20;

/// Returns the approximate number of bytes of memory that values take.
#[must_use]
pub fn bytes_of(values: &Map<String, Value>) -> usize {
    let texts: usize = values.keys().map(String::len).sum();
    let inner: usize = values.values().map(bytes_of_value).sum();
    UNIT * (MAP + values.len()) + texts + inner
}

fn bytes_of_value(value: &Value) -> usize {
    UNIT + match value {
        Value::Null | Value::Bool(_) | Value::Number(_) => 0,
        Value::String(text) => text.len(),
        Value::Array(items) => UNIT * LIST + items.iter().map(bytes_of_value).sum::<usize>(),
        Value::Object(map) => bytes_of(map),
    }
}

/// Deserializes a map, for `#[serde(deserialize_with)]`.
pub(crate) fn bounded<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Map<String, Value>, D::Error> {
    bounded_by(MOST_WEIGHT, deserializer)
}

fn bounded_by<'de, D: Deserializer<'de>>(
    most: usize,
    deserializer: D,
) -> Result<Map<String, Value>, D::Error> {
    let left = Cell::new(most);
    deserializer.deserialize_map(Entries(&left))
}

fn take<E: Error>(left: &Cell<usize>, weight: usize) -> Result<(), E> {
    let rest = left
        .get()
        .checked_sub(weight)
        .ok_or_else(|| E::custom("more values than a message may have"))?;
    left.set(rest);
    Ok(())
}

struct Entries<'a>(&'a Cell<usize>);

impl<'de> Visitor<'de> for Entries<'_> {
    type Value = Map<String, Value>;

    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str("a map")
    }

    fn visit_unit<E: Error>(self) -> Result<Self::Value, E> {
        Ok(Map::new())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Self::Value, A::Error> {
        take(self.0, MAP)?;
        let mut map = Map::new();
        while let Some(key) = entries.next_key::<String>()? {
            take(self.0, 1)?;
            let value = entries.next_value_seed(One(self.0))?;
            map.insert(key, value);
        }
        Ok(map)
    }
}

/// A single value, deserialized like `serde_json::Value`.
struct One<'a>(&'a Cell<usize>);

impl<'de> DeserializeSeed<'de> for One<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        take(self.0, 1)?;
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for One<'_> {
    type Value = Value;

    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str("any value that JSON has")
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(Number::from_f64(value).map_or(Value::Null, Value::Number))
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_string<E>(self, value: String) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_none<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_any(self)
    }

    /// `Reader` calls this for extension types only.
    fn visit_newtype_struct<D: Deserializer<'de>>(self, _: D) -> Result<Value, D::Error> {
        Err(D::Error::custom(
            "a MessagePack extension type (JavaScript: undefined), which JSON does not have",
        ))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        take(self.0, LIST)?;
        let mut list = Vec::new();
        while let Some(item) = items.next_element_seed(One(self.0))? {
            list.push(item);
        }
        Ok(Value::Array(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, entries: A) -> Result<Value, A::Error> {
        Entries(self.0).visit_map(entries).map(Value::Object)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::extension::reader::Reader;
    use proptest::prelude::*;
    use serde_json::json;

    fn read(bytes: &[u8], most: usize) -> Result<Map<String, Value>, String> {
        bounded_by(most, &mut Reader::new(bytes)).map_err(|error| error.to_string())
    }

    fn any_value() -> impl Strategy<Value = Value> {
        let leaf = prop_oneof![
            Just(Value::Null),
            any::<bool>().prop_map(Value::from),
            any::<i64>().prop_map(Value::from),
            any::<u64>().prop_map(Value::from),
            any::<f64>().prop_map(Value::from),
            ".*".prop_map(Value::from),
        ];
        leaf.prop_recursive(4, 64, 8, |inner| {
            prop_oneof![
                prop::collection::vec(inner.clone(), 0..8).prop_map(Value::from),
                prop::collection::btree_map(".*", inner, 0..8)
                    .prop_map(|entries| Value::Object(entries.into_iter().collect())),
            ]
        })
    }

    proptest! {
        #[test]
        fn it_is_read_as_serde_json_reads_it(value in any_value()) {
            let bytes = rmp_serde::to_vec(&json!({ "x": value })).unwrap();
            let plain: Map<String, Value> = rmp_serde::from_slice(&bytes).unwrap();
            prop_assert_eq!(read(&bytes, MOST_WEIGHT), Ok(plain));
        }
    }

    #[test]
    fn what_takes_more_memory_weighs_more() {
        let many = |item: Value, count: usize| json!({ "x": vec![item; count] });
        for (item, weight) in [(json!(1), 1), (json!([1]), 6), (json!({ "": 1 }), 23)] {
            let beside = MAP + 2 + LIST;
            let bytes = rmp_serde::to_vec(&many(item, 1000)).unwrap();
            assert!(read(&bytes, beside + 1000 * weight).is_ok());
            let error = read(&bytes, beside + 1000 * weight - 1).unwrap_err();
            assert!(
                error.contains("more values than a message may have"),
                "{error}"
            );
        }
    }

    #[test]
    fn deep_nesting_is_refused_before_the_stack_ends() {
        let payload =
            |depth: usize| [&[0x81, 0xa1, b'x'][..], &vec![0x91; depth], &[0xc0]].concat();
        assert!(read(&payload(1023), usize::MAX).is_ok());
        for depth in [1024, 1_000_000] {
            let error = read(&payload(depth), usize::MAX).unwrap_err();
            assert!(error.contains("nested too deeply"), "{error}");
        }
    }

    #[test]
    fn an_extension_type_is_named() {
        let undefined = [0x81, 0xa1, b'x', 0xd4, 0x00, 0x00];
        let nested = [0x81, 0xa1, b'x', 0x91, 0xd4, 0x00, 0x00];
        for bytes in [&undefined[..], &nested[..]] {
            let error = read(bytes, MOST_WEIGHT).unwrap_err();
            assert!(
                error.contains("a MessagePack extension type (JavaScript: undefined)"),
                "{error}"
            );
        }
    }

    #[test]
    fn what_is_held_is_counted() {
        let empty = bytes_of(&Map::new());
        let values = json!({ "x": [1, 2, { "y": "abc" }] });
        assert!(bytes_of(values.as_object().unwrap()) > 2 * empty + 3 * UNIT);
    }
}
