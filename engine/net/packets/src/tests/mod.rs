//! Packets encoded by one side and decoded by the other, packets of other implementations, and arbitrary bytes.

mod exchange;
mod fuzz;
mod others;

use super::*;

/// Returns first byte and body of the only packet in these bytes.
fn only(bytes: &[u8]) -> (u8, &[u8]) {
    let (first, header, length) = frame(bytes, usize::MAX).unwrap().unwrap();
    assert_eq!(bytes.len(), header + length, "{bytes:02x?}");
    (first, &bytes[header..])
}

fn by_broker(bytes: &[u8], version: Version) -> Result<Packet<'_>, Refusal> {
    let (first, body) = only(bytes);
    decode(first, body, version)
}

fn by_client(bytes: &[u8], version: Version) -> Result<client::Packet<'_>, Refusal> {
    let (first, body) = only(bytes);
    client::decode(first, body, version)
}
