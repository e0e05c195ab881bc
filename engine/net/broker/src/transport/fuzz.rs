//! Arbitrary input of WebSocket clients is passed on or refused, regardless of how it is split, with memory in
//! proportion to its length.

use super::Origins;
use super::websocket::{BINARY, WebSocket, frame};
use proptest::prelude::*;
use std::sync::Arc;
use swarmwright_fuzzing::{config, mutated, noise, peak};
use tungstenite::protocol::frame::coding::OpCode;

const REQUEST: &[u8] = b"GET /mqtt HTTP/1.1\r\nHost: localhost:9001\r\nOrigin: http://localhost\r\nupgrade: WebSocket\r\nConnection: keep-alive, Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: mqtt\r\n\r\n";
/// Largest size of one read of the socket.
const LONGEST: usize = 1 << 14;

/// Encodes a frame of a client.
pub fn masked(opcode: OpCode, payload: &[u8], mask: [u8; 4]) -> Vec<u8> {
    let mut bytes = Vec::new();
    frame(&mut bytes, opcode, payload);
    let start = bytes.len() - payload.len();
    bytes[1] |= 0x80;
    for (place, byte) in bytes[start..].iter_mut().enumerate() {
        *byte ^= mask[place & 3];
    }
    bytes.splice(start..start, mask);
    bytes
}

/// Returns streams of frames of all kinds and lengths, without the request.
fn golden() -> Vec<Vec<u8>> {
    let mask = [0x12, 0x34, 0x56, 0x78];
    let frames = [
        masked(BINARY, b"\xc0\0", mask),
        masked(BINARY, &[7; 130], mask),
        masked(BINARY, &vec![9; 70_000], mask)[..4000].to_vec(),
        masked(OpCode::from(9), b"there?", mask),
        masked(OpCode::from(9), &[1; 125], mask),
        masked(OpCode::from(10), b"", mask),
        masked(OpCode::from(8), &1000u16.to_be_bytes(), mask),
        // A message in three frames, with a PING between them.
        [
            &[0x02, 0x81, 0, 0, 0, 0, 1][..],
            &masked(OpCode::from(9), b"x", mask),
            &[0x80, 0x81, 1, 1, 1, 1, 2],
        ]
        .concat(),
    ];
    let mut streams: Vec<Vec<u8>> = frames.to_vec();
    streams.push(frames.concat());
    streams
}

/// Processes a stream in pieces. Returns the MQTT bytes, the answers, and the error, if any.
fn take(stream: &[u8], pieces: &[usize]) -> (Vec<u8>, Vec<u8>, Option<String>) {
    let mut socket = WebSocket::new(Arc::new(Origins::default()));
    let (mut mqtt, mut replies) = (Vec::new(), Vec::new());
    let mut rest = stream;
    for size in pieces.iter().chain(std::iter::repeat(&LONGEST)) {
        if rest.is_empty() {
            break;
        }
        let (piece, after) = rest.split_at((*size).min(rest.len()));
        if let Err(wrong) = socket.received(piece, &mut mqtt, &mut replies) {
            return (mqtt, replies, Some(wrong));
        }
        rest = after;
    }
    (mqtt, replies, None)
}

fn check(stream: &[u8], pieces: &[usize]) {
    let ((mqtt, replies, wrong), bytes) = peak(|| take(stream, pieces));
    assert!(mqtt.len() <= stream.len());
    // A PONG is as long as its PING without the mask; a refusal repeats at most an origin.
    assert!(replies.len() <= 3 * stream.len() + 1024);
    assert!(
        bytes <= 24 * stream.len() + 16_384,
        "{bytes} bytes for {}",
        stream.len()
    );
    assert_eq!(
        take(stream, &[]),
        (mqtt, replies, wrong),
        "cut in pieces of {pieces:?}"
    );
}

fn pieces() -> impl Strategy<Value = Vec<usize>> {
    prop::collection::vec(1usize..90, 0..20)
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn frames_that_are_nearly_right(bytes in mutated(golden()), pieces in pieces()) {
        check(&[REQUEST, &bytes].concat(), &pieces);
    }

    #[test]
    fn requests_that_are_nearly_right(bytes in mutated(vec![REQUEST.to_vec()]), pieces in pieces()) {
        check(&bytes, &pieces);
    }

    #[test]
    fn what_is_never_right(bytes in noise(), pieces in pieces(), open in any::<bool>()) {
        let stream = if open { [REQUEST, &bytes].concat() } else { bytes };
        check(&stream, &pieces);
    }
}
