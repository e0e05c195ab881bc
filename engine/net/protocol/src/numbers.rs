//! Numbers in JSON messages: integers written as 1 or 1.0, and finite reals.

use std::fmt;

use serde::de::{Deserialize, Deserializer, Error, Unexpected, Visitor};
use serde::ser::{Serialize, Serializer};

/// An identifier: an integer from 0 to 2^63 - 1, which the integers of every language can hold; 1.0 is valid (JSON
/// Schema), 1.5 is not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Id(pub u64);

impl Serialize for Id {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u64(self.0)
    }
}

impl<'de> Deserialize<'de> for Id {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct IdVisitor;
        impl Visitor<'_> for IdVisitor {
            type Value = Id;
            fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
                formatter.write_str("an integer from 0 to 9223372036854775807")
            }
            fn visit_u64<E: Error>(self, value: u64) -> Result<Id, E> {
                if i64::try_from(value).is_ok() {
                    Ok(Id(value))
                } else {
                    Err(E::invalid_value(Unexpected::Unsigned(value), &self))
                }
            }
            fn visit_i64<E: Error>(self, value: i64) -> Result<Id, E> {
                u64::try_from(value)
                    .map(Id)
                    .map_err(|_| E::invalid_value(Unexpected::Signed(value), &self))
            }
            fn visit_f64<E: Error>(self, value: f64) -> Result<Id, E> {
                // Every binary64 integer below 2^63 fits into an i64.
                if value.fract() == 0.0 && (0.0..9_223_372_036_854_775_808.0).contains(&value) {
                    #[expect(
                        clippy::cast_possible_truncation,
                        clippy::cast_sign_loss,
                        reason = "checked above"
                    )]
                    return Ok(Id(value as u64));
                }
                Err(E::invalid_value(Unexpected::Float(value), &self))
            }
        }
        deserializer.deserialize_any(IdVisitor)
    }
}

/// A finite binary32, the nearest to the decimal in the message.
pub struct Real32(pub f32);

impl<'de> Deserialize<'de> for Real32 {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = f32::deserialize(deserializer)?;
        if value.is_finite() {
            Ok(Self(value))
        } else {
            Err(D::Error::custom("number out of the range of binary32"))
        }
    }
}

/// A finite binary64.
pub struct Real64(pub f64);

impl<'de> Deserialize<'de> for Real64 {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = f64::deserialize(deserializer)?;
        if value.is_finite() {
            Ok(Self(value))
        } else {
            Err(D::Error::custom("number out of the range of binary64"))
        }
    }
}
