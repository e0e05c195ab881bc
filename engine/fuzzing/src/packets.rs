//! Packets of MQTT.

/// Packets of all kinds that a client may send, of MQTT 3.1.1 and 5.
#[must_use]
pub fn packets_of_clients() -> Vec<Vec<u8>> {
    [
        &b"\x10\x0f\0\x04MQTT\x04\x02\0\x3c\0\x03ada"[..],
        b"\x10\x16\0\x06MQIsdp\x03\xc2\0\x0a\0\x01a\0\x01u\0\x01p",
        b"\x10\x3b\0\x04MQTT\x05\xee\0\x3c\x0b\x11\0\0\0\x3c\x21\0\x10\x22\0\0\0\x01a\x0a\x18\0\0\0\x05\x02\0\0\0\x09\0\x03a/b\0\x04lost\0\x01u\0\x02pw",
        b"\x30\x0c\0\x03a/bhello w",
        b"\x33\x0b\0\x03a/b\0\x07\0four",
        b"\x3d\x29\0\x03a/b\0\x08\x1d\x01\x01\x02\0\0\0\x3c\x03\0\x01t\x08\0\x03c/d\x09\0\x02\x01\x02\x26\0\x01k\0\x01vpay",
        b"\x40\x02\0\x07",
        b"\x50\x04\0\x07\x10\0",
        b"\x62\x02\0\x07",
        b"\x70\x03\0\x07\x92",
        b"\x82\x0d\0\x01\0\0\x03a/+\x01\0\x01#\x2e",
        b"\x82\x0a\0\x02\x02\x0b\x7f\0\x02$S\0",
        b"\xa2\x08\0\x03\0\0\x03a/+",
        b"\xc0\0",
        b"\xe0\0",
        b"\xe0\x07\x04\x05\x11\0\0\0\x09",
    ]
    .iter()
    .map(|packet| packet.to_vec())
    .collect()
}
