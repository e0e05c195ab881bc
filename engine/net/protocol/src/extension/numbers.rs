//! Arrays of numbers in binary form.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Defines an array that is encoded as little-endian bytes.
macro_rules! numbers {
    ($(#[$doc:meta])* $name:ident, $number:ty) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Default)]
        pub struct $name(pub Vec<$number>);

        impl Serialize for $name {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                let mut bytes = vec![0; size_of_val(&self.0[..])];
                let (rows, _) = bytes.as_chunks_mut::<{ size_of::<$number>() }>();
                for (row, number) in rows.iter_mut().zip(&self.0) {
                    *row = number.to_le_bytes();
                }
                serializer.serialize_bytes(&bytes)
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Numbers;

                impl serde::de::Visitor<'_> for Numbers {
                    type Value = $name;

                    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
                        formatter.write_str("binary")
                    }

                    fn visit_bytes<E: serde::de::Error>(self, bytes: &[u8]) -> Result<$name, E> {
                        const SIZE: usize = size_of::<$number>();
                        let (numbers, rest) = bytes.as_chunks::<SIZE>();
                        if !rest.is_empty() {
                            return Err(E::custom(format_args!(
                                "{} bytes are not a whole number of {SIZE}-byte numbers",
                                bytes.len()
                            )));
                        }
                        Ok($name(numbers.iter().map(|number| <$number>::from_le_bytes(*number)).collect()))
                    }
                }

                deserializer.deserialize_bytes(Numbers)
            }
        }
    };
}

numbers!(
    /// binary32 numbers.
    F32s, f32
);
numbers!(
    /// binary64 numbers.
    F64s, f64
);
numbers!(
    /// Unsigned 32-bit integers.
    U32s, u32
);
numbers!(
    /// Unsigned 64-bit integers.
    U64s, u64
);
