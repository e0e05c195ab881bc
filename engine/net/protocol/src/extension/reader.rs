//! MessagePack to types of Rust, with the path of a field that does not fit.
//!
//! `rmp_serde` compiles its whole decoder anew for each type, and `serde_path_to_error` does so once more: half of the time that
//! this crate took. Here each value is read into a [`Token`] first, by code that is compiled once.

use rmp::Marker;
use serde::de::value::{BorrowedStrDeserializer, UnitDeserializer};
use serde::de::{
    DeserializeOwned, DeserializeSeed, Error as _, Expected, MapAccess, SeqAccess, Unexpected,
    Visitor,
};
use serde::{Deserializer, forward_to_deserialize_any};
use swarmwright_values::{Error, Mismatch, Segment};

/// Largest depth of lists and maps in each other.
const MOST_DEPTH: u16 = 1024;

/// Decodes a value; bytes after it are ignored.
pub(super) fn read<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Mismatch> {
    T::deserialize(&mut Reader::new(bytes)).map_err(Mismatch::from)
}

/// A single value, or the start of a list or map with this many items or entries.
enum Token<'de> {
    Nil,
    Bool(bool),
    Unsigned(u64),
    Signed(i64),
    Float(f64),
    Text(&'de str),
    Binary(&'de [u8]),
    List(u32),
    Map(u32),
    Extension,
}

impl Token<'_> {
    fn unexpected(&self, expected: &dyn Expected) -> Error {
        let unexpected = match *self {
            Self::Nil => Unexpected::Unit,
            Self::Bool(value) => Unexpected::Bool(value),
            Self::Unsigned(value) => Unexpected::Unsigned(value),
            Self::Signed(value) => Unexpected::Signed(value),
            Self::Float(value) => Unexpected::Float(value),
            Self::Text(text) => Unexpected::Str(text),
            Self::Binary(bytes) => Unexpected::Bytes(bytes),
            Self::List(_) => Unexpected::Seq,
            Self::Map(_) => Unexpected::Map,
            Self::Extension => Unexpected::NewtypeStruct,
        };
        Error::invalid_type(unexpected, expected)
    }
}

/// Reads one value after the other.
pub(crate) struct Reader<'de> {
    rest: &'de [u8],
    /// Number of further levels that may follow.
    depth: u16,
}

impl<'de> Reader<'de> {
    pub(crate) fn new(bytes: &'de [u8]) -> Self {
        let (rest, depth) = (bytes, MOST_DEPTH);
        Self { rest, depth }
    }

    fn take(&mut self, count: u32) -> Result<&'de [u8], Error> {
        let (bytes, rest) = self
            .rest
            .split_at_checked(count as usize)
            .ok_or_else(ended)?;
        self.rest = rest;
        Ok(bytes)
    }

    fn number<const SIZE: usize>(&mut self) -> Result<[u8; SIZE], Error> {
        let (bytes, rest) = self.rest.split_first_chunk().ok_or_else(ended)?;
        self.rest = rest;
        Ok(*bytes)
    }

    fn length8(&mut self) -> Result<u32, Error> {
        self.number().map(u8::from_be_bytes).map(u32::from)
    }

    fn length16(&mut self) -> Result<u32, Error> {
        self.number().map(u16::from_be_bytes).map(u32::from)
    }

    fn length32(&mut self) -> Result<u32, Error> {
        self.number().map(u32::from_be_bytes)
    }

    fn text(&mut self, length: u32) -> Result<Token<'de>, Error> {
        let text = std::str::from_utf8(self.take(length)?);
        text.map(Token::Text)
            .map_err(|_| Error::custom("text that is not valid UTF-8"))
    }

    fn extension(&mut self, length: u32) -> Result<Token<'de>, Error> {
        self.number::<1>()?;
        self.take(length).map(|_| Token::Extension)
    }

    fn token(&mut self) -> Result<Token<'de>, Error> {
        let [byte] = self.number()?;
        Ok(match Marker::from_u8(byte) {
            Marker::Null => Token::Nil,
            Marker::False => Token::Bool(false),
            Marker::True => Token::Bool(true),
            Marker::FixPos(value) => Token::Unsigned(value.into()),
            Marker::U8 => Token::Unsigned(u8::from_be_bytes(self.number()?).into()),
            Marker::U16 => Token::Unsigned(u16::from_be_bytes(self.number()?).into()),
            Marker::U32 => Token::Unsigned(u32::from_be_bytes(self.number()?).into()),
            Marker::U64 => Token::Unsigned(u64::from_be_bytes(self.number()?)),
            Marker::FixNeg(value) => Token::Signed(value.into()),
            Marker::I8 => Token::Signed(i8::from_be_bytes(self.number()?).into()),
            Marker::I16 => Token::Signed(i16::from_be_bytes(self.number()?).into()),
            Marker::I32 => Token::Signed(i32::from_be_bytes(self.number()?).into()),
            Marker::I64 => Token::Signed(i64::from_be_bytes(self.number()?)),
            Marker::F32 => Token::Float(f32::from_be_bytes(self.number()?).into()),
            Marker::F64 => Token::Float(f64::from_be_bytes(self.number()?)),
            marker => self.long_token(marker)?,
        })
    }

    /// A token with a length.
    fn long_token(&mut self, marker: Marker) -> Result<Token<'de>, Error> {
        let length = match marker {
            Marker::FixStr(length) | Marker::FixArray(length) | Marker::FixMap(length) => {
                length.into()
            }
            Marker::FixExt1 => 1,
            Marker::FixExt2 => 2,
            Marker::FixExt4 => 4,
            Marker::FixExt8 => 8,
            Marker::FixExt16 => 16,
            Marker::Str8 | Marker::Bin8 | Marker::Ext8 => self.length8()?,
            Marker::Str16 | Marker::Bin16 | Marker::Ext16 | Marker::Array16 | Marker::Map16 => {
                self.length16()?
            }
            _ => self.length32()?,
        };
        match marker {
            Marker::FixStr(_) | Marker::Str8 | Marker::Str16 | Marker::Str32 => self.text(length),
            Marker::Bin8 | Marker::Bin16 | Marker::Bin32 => self.take(length).map(Token::Binary),
            Marker::FixArray(_) | Marker::Array16 | Marker::Array32 => Ok(Token::List(length)),
            Marker::FixMap(_) | Marker::Map16 | Marker::Map32 => Ok(Token::Map(length)),
            Marker::Reserved => Err(Error::custom("a byte that MessagePack does not have")),
            _ => self.extension(length),
        }
    }

    /// Skips a value.
    fn skip(&mut self) -> Result<(), Error> {
        let mut left = 1_u64;
        while left > 0 {
            left -= 1;
            left += match self.token()? {
                Token::List(length) => length.into(),
                Token::Map(length) => 2 * u64::from(length),
                _ => 0,
            };
        }
        Ok(())
    }

    /// Reads what is in a list or a map.
    fn nested<T>(&mut self, read: impl FnOnce(&mut Self) -> Result<T, Error>) -> Result<T, Error> {
        self.enter()?;
        let result = read(self);
        self.depth += 1;
        result
    }

    fn enter(&mut self) -> Result<(), Error> {
        let depth = self.depth.checked_sub(1);
        self.depth = depth.ok_or_else(|| Error::custom("lists and maps nested too deeply"))?;
        Ok(())
    }

    fn items<V: Visitor<'de>>(&mut self, left: u32, visitor: V) -> Result<V::Value, Error> {
        self.nested(|reader| {
            let mut items = Items {
                reader,
                index: 0,
                left,
            };
            let value = visitor.visit_seq(&mut items)?;
            complete(items.left).map(|()| value)
        })
    }

    fn entries<V: Visitor<'de>>(&mut self, left: u32, visitor: V) -> Result<V::Value, Error> {
        self.nested(|reader| {
            let mut entries = Entries {
                reader,
                key: "",
                left,
            };
            let value = visitor.visit_map(&mut entries)?;
            complete(entries.left).map(|()| value)
        })
    }
}

fn ended() -> Error {
    Error::custom("the message ends too early")
}

fn complete(left: u32) -> Result<(), Error> {
    match left {
        0 => Ok(()),
        _ => Err(Error::custom(format_args!("{left} items too many"))),
    }
}

/// A value that is neither a list nor a map, or the error that it is.
fn single<'de, V: Visitor<'de>>(token: Token<'de>, visitor: V) -> Result<V::Value, Error> {
    match token {
        Token::Nil => visitor.visit_unit(),
        Token::Bool(value) => visitor.visit_bool(value),
        Token::Unsigned(value) => visitor.visit_u64(value),
        Token::Signed(value) => visitor.visit_i64(value),
        Token::Float(value) => visitor.visit_f64(value),
        Token::Text(text) => visitor.visit_borrowed_str(text),
        Token::Binary(bytes) => visitor.visit_borrowed_bytes(bytes),
        Token::Extension => visitor.visit_newtype_struct(UnitDeserializer::new()),
        Token::List(_) | Token::Map(_) => Err(token.unexpected(&visitor)),
    }
}

/// Methods for types without items and fields: code that reads those is not compiled for them.
macro_rules! single {
    ($($method:ident)*) => {
        $(fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
            single(self.token()?, visitor)
        })*
    };
}

impl<'de> Deserializer<'de> for &mut Reader<'de> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.token()? {
            Token::List(length) => self.items(length, visitor),
            Token::Map(length) => self.entries(length, visitor),
            token => single(token, visitor),
        }
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.token()? {
            Token::List(length) => self.items(length, visitor),
            token => single(token, visitor),
        }
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, Error> {
        self.deserialize_seq(visitor)
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.token()? {
            Token::Map(length) => self.entries(length, visitor),
            token => single(token, visitor),
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
        match self.rest.split_first() {
            Some((&byte, rest)) if byte == Marker::Null.to_u8() => {
                self.rest = rest;
                visitor.visit_none()
            }
            _ => visitor.visit_some(self),
        }
    }

    /// Variants of messages have no fields.
    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        match self.token()? {
            Token::Text(text) => visitor.visit_enum(BorrowedStrDeserializer::new(text)),
            token => Err(token.unexpected(&"string")),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        self.skip()?;
        visitor.visit_unit()
    }

    single! {
        deserialize_bool deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64 deserialize_u8 deserialize_u16 deserialize_u32
        deserialize_u64 deserialize_f32 deserialize_f64 deserialize_str deserialize_string deserialize_identifier deserialize_bytes
    }

    forward_to_deserialize_any! { i128 u128 char byte_buf unit unit_struct tuple_struct }
}

struct Items<'a, 'de> {
    reader: &'a mut Reader<'de>,
    index: usize,
    left: u32,
}

impl<'de> SeqAccess<'de> for Items<'_, 'de> {
    type Error = Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, Error> {
        if self.left == 0 {
            return Ok(None);
        }
        let index = self.index;
        self.left -= 1;
        self.index += 1;
        let item = seed.deserialize(&mut *self.reader);
        item.map(Some)
            .map_err(|error| error.inside(Segment::Item(index)))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.left as usize)
    }
}

struct Entries<'a, 'de> {
    reader: &'a mut Reader<'de>,
    /// The key whose value comes next.
    key: &'de str,
    left: u32,
}

impl Entries<'_, '_> {
    fn inside(&self, error: Error) -> Error {
        error.inside(Segment::Field(self.key.to_owned()))
    }
}

impl<'de> MapAccess<'de> for Entries<'_, 'de> {
    type Error = Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, Error> {
        if self.left == 0 {
            return Ok(None);
        }
        self.left -= 1;
        self.key = match self.reader.token()? {
            Token::Text(key) => key,
            token => return Err(token.unexpected(&"text as a key")),
        };
        let key = seed.deserialize(BorrowedStrDeserializer::new(self.key));
        key.map(Some).map_err(|error| self.inside(error))
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, Error> {
        let value = seed.deserialize(&mut *self.reader);
        value.map_err(|error| self.inside(error))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.left as usize)
    }
}
