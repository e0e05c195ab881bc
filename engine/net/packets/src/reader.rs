//! The data types of MQTT 5.0, chapter 1.5, read from a slice.

use crate::Refusal;

/// A reader at the front of a slice; every method fails if too few bytes are left.
#[derive(Clone, Copy)]
pub struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }

    pub fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// Checks that no bytes are left.
    pub fn end(&self) -> Result<(), Refusal> {
        if self.is_empty() {
            Ok(())
        } else {
            Err(Refusal::malformed("a packet is longer than its fields"))
        }
    }

    pub fn take(&mut self, length: usize) -> Result<&'a [u8], Refusal> {
        let Some((bytes, rest)) = self.rest.split_at_checked(length) else {
            return Err(Refusal::malformed(
                "the packet ends in the middle of a field",
            ));
        };
        self.rest = rest;
        Ok(bytes)
    }

    pub fn u8(&mut self) -> Result<u8, Refusal> {
        Ok(self.take(1)?[0])
    }

    pub fn u16(&mut self) -> Result<u16, Refusal> {
        let bytes = self.take(2)?;
        Ok(u16::from_be_bytes([bytes[0], bytes[1]]))
    }

    pub fn u32(&mut self) -> Result<u32, Refusal> {
        let bytes = self.take(4)?;
        Ok(u32::from_be_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    /// Reads a variable byte integer of at most four bytes.
    pub fn variable(&mut self) -> Result<u32, Refusal> {
        let mut value = 0;
        for index in 0..4 {
            let byte = self.u8()?;
            value |= u32::from(byte & 0x7f) << (7 * index);
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(Refusal::malformed(
            "a variable byte integer is longer than four bytes",
        ))
    }

    pub fn binary(&mut self) -> Result<&'a [u8], Refusal> {
        let length = self.u16()?;
        self.take(usize::from(length))
    }

    pub fn string(&mut self) -> Result<&'a str, Refusal> {
        let text = std::str::from_utf8(self.binary()?)
            .map_err(|_| Refusal::malformed("a string is not UTF-8"))?;
        if text.as_bytes().contains(&0) {
            return Err(Refusal::malformed("a string contains the character U+0000"));
        }
        Ok(text)
    }
}
