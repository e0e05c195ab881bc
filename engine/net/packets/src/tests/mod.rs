//! Packets written by one side and read by the other, bytes of somebody else's clients and brokers, and bytes of nobody.

mod exchange;
mod fuzz;
mod others;

use super::*;

/// The only packet in these bytes: its first byte and its body.
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
