//! Payloads that are nearly right: golden ones with a few bytes changed, moved, repeated, cut off.

use proptest::collection::vec;
use proptest::prelude::*;

/// Changes of one payload.
const CHANGES: usize = 6;
/// The longest piece that is moved about at once.
const LONGEST: usize = 64;
/// Longer payloads than this are cut: repetitions may double one again and again.
const LIMIT: usize = 1 << 14;

/// What JSON, MessagePack, MQTT and text files have of their own: limits, lengths that promise too much, ends that are
/// missing.
const TOKENS: &[&[u8]] = &[
    b"null",
    b"true",
    b"{",
    b"}",
    b"[",
    b"]",
    b"[[[[[[[[",
    b"{\"\":",
    b"\"",
    b"\\",
    b"\\u0000",
    b"\\ud800",
    b"\\u00e4",
    b",",
    b":",
    b"-",
    b"0",
    b"1e999",
    b"-0.0",
    b"1e-400",
    b"9223372036854775807",
    b"9223372036854775808",
    b"18446744073709551616",
    b"0.1e1",
    b"NaN",
    b"\n",
    b"\r\n",
    b"\0",
    b" ",
    b"#",
    b"$",
    b"+",
    b"/",
    b"\x7f",
    b"\xff",
    b"\xff\xff\xff\xff",
    b"\x80\x80\x80\x80",
    b"\xff\xff\xff\x7f",
    b"\x00\x00",
    b"\x00\x01",
    b"\xff\xff",
    b"\xc0",
    b"\xc2",
    b"\xc3",
    b"\xc4\xff",
    b"\xc5\xff\xff",
    b"\xc6\xff\xff\xff\xff",
    b"\xca\x7f\xc0\x00\x00",
    b"\xcb\x7f\xf8\x00\x00\x00\x00\x00\x00",
    b"\xcf\xff\xff\xff\xff\xff\xff\xff\xff",
    b"\xd3\x80\x00\x00\x00\x00\x00\x00\x00",
    b"\xd9\xff",
    b"\xdb\xff\xff\xff\xff",
    b"\xdc\xff\xff",
    b"\xdd\xff\xff\xff\xff",
    b"\xde\xff\xff",
    b"\xdf\xff\xff\xff\xff",
    b"\x81\x81\x81\x81",
    b"\x91\x91\x91\x91",
    b"\xc7\xff\x01",
    b"\xed\xa0\x80",
    b"\xf0\x9f\x98\x80",
];

/// Which change, where, how long, what else.
type Change = (u8, u32, u32, u32);

/// A position from 0 to `end`, inclusive.
fn place(drawn: u32, end: usize) -> usize {
    drawn as usize % (end + 1)
}

fn apply(bytes: &mut Vec<u8>, (kind, at, length, more): Change, corpus: &[Vec<u8>]) {
    let at = place(at, bytes.len());
    let length = place(length, LONGEST.min(bytes.len() - at));
    match kind % 8 {
        0 => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << (more % 8);
            }
        }
        1 => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte = more.to_le_bytes()[0];
            }
        }
        2 => drop(bytes.drain(at..at + length)),
        3 => {
            let piece = bytes[at..at + length].to_vec();
            let to = place(more, bytes.len());
            bytes.splice(to..to, piece);
        }
        4 => {
            let token = TOKENS[more as usize % TOKENS.len()];
            bytes.splice(at..at, token.iter().copied());
        }
        5 => {
            let token = TOKENS[more as usize % TOKENS.len()];
            let end = (at + token.len()).min(bytes.len());
            bytes.splice(at..end, token.iter().copied());
        }
        6 => bytes.truncate(at),
        _ => {
            // The end of another payload.
            let other = &corpus[more as usize % corpus.len()];
            bytes.truncate(at);
            bytes.extend_from_slice(&other[place(more, other.len())..]);
        }
    }
    bytes.truncate(LIMIT);
}

/// Golden payloads, changed in up to six places; not changed at all once in a while.
///
/// # Panics
/// The corpus is empty.
pub fn mutated(corpus: Vec<Vec<u8>>) -> impl Strategy<Value = Vec<u8>> {
    assert!(!corpus.is_empty(), "nothing to change");
    let changes = vec(any::<Change>(), 0..=CHANGES);
    (0..corpus.len(), changes).prop_map(move |(golden, changes)| {
        let mut bytes = corpus[golden].clone();
        for change in changes {
            apply(&mut bytes, change, &corpus);
        }
        bytes
    })
}

/// Bytes of no meaning, and tokens of all formats in a row.
pub fn noise() -> impl Strategy<Value = Vec<u8>> {
    let tokens = vec(0..TOKENS.len(), 0..24);
    let tokens = tokens.prop_map(|drawn| {
        drawn
            .into_iter()
            .flat_map(|token| TOKENS[token].to_vec())
            .collect()
    });
    prop_oneof![vec(any::<u8>(), 0..200), tokens]
}
