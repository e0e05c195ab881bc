//! WebSocket server (RFC 6455), as far as MQTT needs it (MQTT 5.0, chapter 6). tungstenite parses the request and the
//! headers of frames; payloads are passed on as they arrive, without assembling messages
//! (docs/decisions/011-websocket.md).

use super::Origins;
use std::borrow::Cow;
use std::io::Cursor;
use std::sync::Arc;
use tungstenite::handshake::machine::TryParse;
use tungstenite::handshake::server::{Request, create_response};
use tungstenite::http::HeaderMap;
use tungstenite::protocol::frame::FrameHeader;
use tungstenite::protocol::frame::coding::{Control, Data, OpCode};

/// Largest size in bytes of an upgrade request.
const MAX_REQUEST: usize = 16 << 10;
/// Largest size in bytes of a frame header.
const MAX_HEADER: usize = 14;
/// Largest size in bytes of a control frame's payload.
const MAX_CONTROL: u64 = 125;
const BAD_REQUEST: &str = "400 Bad Request";
const EXPECTED: &str = "this port speaks MQTT over WebSocket; expected a GET request with an upgrade to WebSocket version 13";

/// Opcode of a frame with binary data.
pub const BINARY: OpCode = OpCode::Data(Data::Binary);
const CLOSE: OpCode = OpCode::Control(Control::Close);
const PONG: OpCode = OpCode::Control(Control::Pong);

/// State of one connection, from its HTTP request on.
pub struct WebSocket {
    origins: Arc<Origins>,
    is_open: bool,
    /// Received part of the request, of a frame header, or of the payload of a control frame.
    partial: Vec<u8>,
    frame: Option<Incoming>,
}

/// A frame whose payload is being received.
struct Incoming {
    opcode: OpCode,
    /// Mask, rotated to the next byte of the payload.
    mask: [u8; 4],
    left: u64,
}

impl WebSocket {
    /// Creates the state before the request.
    pub fn new(origins: Arc<Origins>) -> Self {
        Self {
            origins,
            is_open: false,
            partial: Vec::new(),
            frame: None,
        }
    }

    /// Processes received bytes; MQTT bytes are appended to `mqtt`, and answers to `replies`.
    pub fn received(
        &mut self,
        bytes: &[u8],
        mqtt: &mut Vec<u8>,
        replies: &mut Vec<u8>,
    ) -> Result<(), String> {
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = match &mut self.frame {
                _ if !self.is_open => self.request(rest, replies)?,
                None => self.header(rest, replies)?,
                Some(frame) => {
                    let is_control = matches!(frame.opcode, OpCode::Control(_));
                    frame.unmask(rest, if is_control { &mut self.partial } else { mqtt })
                }
            };
            if self.frame.as_ref().is_some_and(|frame| frame.left == 0) {
                self.end_of_frame(replies)?;
            }
        }
        Ok(())
    }

    fn request<'a>(&mut self, bytes: &'a [u8], replies: &mut Vec<u8>) -> Result<&'a [u8], String> {
        let before = self.partial.len();
        self.partial.extend_from_slice(bytes);
        // Do not search from the start again if a request arrives byte by byte.
        let from = before.saturating_sub(3);
        let blank_line = self.partial[from..]
            .windows(4)
            .position(|window| window == b"\r\n\r\n");
        let Some(end) = blank_line.map(|index| from + index + 4) else {
            return if self.partial.len() > MAX_REQUEST {
                Err("the WebSocket request is longer than 16 KiB".into())
            } else {
                Ok(&[])
            };
        };
        let request = std::mem::take(&mut self.partial);
        match answer(&request[..end], &self.origins) {
            Ok(answer) => replies.extend_from_slice(answer.as_bytes()),
            Err((status, wrong)) => {
                let head =
                    "Connection: close\r\nContent-Type: text/plain\r\nSec-WebSocket-Version: 13";
                let length = wrong.len() + 1;
                let answer = format!(
                    "HTTP/1.1 {status}\r\n{head}\r\nContent-Length: {length}\r\n\r\n{wrong}\n"
                );
                replies.extend_from_slice(answer.as_bytes());
                return Err(wrong);
            }
        }
        self.is_open = true;
        Ok(&bytes[end - before..])
    }

    fn header<'a>(&mut self, bytes: &'a [u8], replies: &mut Vec<u8>) -> Result<&'a [u8], String> {
        let before = self.partial.len();
        let count = bytes.len().min(MAX_HEADER - before);
        self.partial.extend_from_slice(&bytes[..count]);
        let mut cursor = Cursor::new(&self.partial);
        let (header, left) = match FrameHeader::parse(&mut cursor) {
            Ok(Some(parsed)) => parsed,
            Ok(None) => return Ok(&bytes[count..]),
            Err(error) => return Err(refuse(format!("WebSocket: {error}"), replies)),
        };
        let end = cursor.position() as usize;
        self.partial.clear();
        let is_control = matches!(header.opcode, OpCode::Control(_));
        let mask = match header.mask {
            Some(mask) if !(header.rsv1 || header.rsv2 || header.rsv3) => mask,
            _ => {
                let wrong = "a WebSocket frame without mask, or with an extension";
                return Err(refuse(wrong.into(), replies));
            }
        };
        if header.opcode == OpCode::Data(Data::Text) {
            return Err(refuse(
                "a WebSocket frame that is not binary".into(),
                replies,
            ));
        }
        if is_control && (left > MAX_CONTROL || !header.is_final) {
            let wrong = "a WebSocket control frame that is fragmented or too long";
            return Err(refuse(wrong.into(), replies));
        }
        self.frame = Some(Incoming {
            opcode: header.opcode,
            mask,
            left,
        });
        Ok(&bytes[end - before..])
    }

    fn end_of_frame(&mut self, replies: &mut Vec<u8>) -> Result<(), String> {
        let Some(Incoming {
            opcode: OpCode::Control(control),
            ..
        }) = self.frame.take()
        else {
            return Ok(());
        };
        let payload = std::mem::take(&mut self.partial);
        match control {
            Control::Ping => frame(replies, PONG, &payload),
            Control::Close => {
                frame(replies, CLOSE, &payload);
                return Err(String::new());
            }
            _ => {}
        }
        Ok(())
    }
}

impl Incoming {
    /// Appends the payload in `bytes` to `target`; returns the bytes after it.
    fn unmask<'a>(&mut self, bytes: &'a [u8], target: &mut Vec<u8>) -> &'a [u8] {
        let length = usize::try_from(self.left).map_or(bytes.len(), |left| left.min(bytes.len()));
        let (payload, rest) = bytes.split_at(length);
        let start = target.len();
        target.extend_from_slice(payload);
        // Processing words is faster than bytes.
        let (words, tail) = target[start..].as_chunks_mut::<4>();
        let mask = u32::from_ne_bytes(self.mask);
        for word in words {
            *word = (u32::from_ne_bytes(*word) ^ mask).to_ne_bytes();
        }
        for (byte, mask) in tail.iter_mut().zip(self.mask) {
            *byte ^= mask;
        }
        self.mask.rotate_left(length & 3);
        self.left -= length as u64;
        rest
    }
}

/// Closes the connection because of a protocol error (1002).
fn refuse(wrong: String, replies: &mut Vec<u8>) -> String {
    frame(replies, CLOSE, &1002u16.to_be_bytes());
    wrong
}

/// Appends a complete frame, unmasked as required of servers. An empty data frame is omitted.
pub fn frame(out: &mut Vec<u8>, opcode: OpCode, payload: &[u8]) {
    let header = FrameHeader {
        opcode,
        ..FrameHeader::default()
    };
    if payload.is_empty() && matches!(opcode, OpCode::Data(_)) {
        return;
    }
    // Writing to a vector cannot fail.
    let _ = header.format(payload.len() as u64, out);
    out.extend_from_slice(payload);
}

/// Returns the answer to an upgrade request, or the HTTP status and the problem.
fn answer(request: &[u8], origins: &Origins) -> Result<String, (&'static str, String)> {
    let bad = |wrong: &str| (BAD_REQUEST, wrong.to_owned());
    let explain = |error: tungstenite::Error| bad(&format!("{EXPECTED} ({error})"));
    let parsed = Request::try_parse(request).map_err(explain)?;
    let (_, request) = parsed.ok_or_else(|| bad(EXPECTED))?;
    let response = create_response(&request).map_err(explain)?;
    let protocol = ["mqtt", "mqttv3.1"]
        .into_iter()
        .find(|protocol| offers(request.headers(), protocol))
        .ok_or_else(|| bad("expected the WebSocket subprotocol `mqtt`"))?;
    let origin = text(request.headers(), "Origin");
    let host = text(request.headers(), "Host");
    if !origins.allow(origin.as_deref(), host.as_deref()) {
        let page = origin.unwrap_or_default();
        let wrong = format!(
            "pages from {page:?} may not connect; `swarmwright broker --origin {page}` allows them"
        );
        return Err(("403 Forbidden", wrong));
    }
    let accept = text(response.headers(), "Sec-WebSocket-Accept").unwrap_or_default();
    // `write_response` would write header names in lower case.
    Ok(format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept}\r\nSec-WebSocket-Protocol: {protocol}\r\n\r\n"
    ))
}

fn text<'a>(headers: &'a HeaderMap, name: &str) -> Option<Cow<'a, str>> {
    let value = headers.get(name)?;
    Some(String::from_utf8_lossy(value.as_bytes()))
}

fn offers(headers: &HeaderMap, protocol: &str) -> bool {
    let values = headers.get_all("Sec-WebSocket-Protocol");
    values
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .any(|name| name.trim().eq_ignore_ascii_case(protocol))
}

#[cfg(test)]
mod tests {
    use super::super::fuzz::masked;
    use super::*;
    use proptest::prelude::*;

    const PING: OpCode = OpCode::Control(Control::Ping);
    const REQUEST: &str = "GET /mqtt HTTP/1.1\r\nHost: x\r\nupgrade: WebSocket\r\nConnection: keep-alive, Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: mqtt\r\n\r\n";

    #[test]
    fn the_key_of_the_standard_is_answered() {
        let answer = answer(REQUEST.as_bytes(), &Origins::default()).unwrap();
        assert!(
            answer.contains("Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo=\r\n"),
            "{answer}"
        );
    }

    #[test]
    fn requests_that_are_not_for_mqtt_are_refused() {
        for (part, other, reason) in [
            ("GET ", "POST ", "only GET is allowed"),
            ("HTTP/1.1", "HTTP/1.0", "HTTP version"),
            ("keep-alive, Upgrade", "keep-alive", "Connection: upgrade"),
            ("Version: 13", "Version: 12", "Sec-WebSocket-Version"),
            ("Sec-WebSocket-Key", "X-Key", "Sec-WebSocket-Key"),
            (
                "Protocol: mqtt",
                "Protocol: chat, mqt",
                "subprotocol `mqtt`",
            ),
        ] {
            let request = REQUEST.replace(part, other);
            let (status, wrong) = answer(request.as_bytes(), &Origins::default()).unwrap_err();
            assert_eq!(status, "400 Bad Request");
            assert!(wrong.contains(reason), "{other}: {wrong}");
        }
    }

    /// Creates a connection that has handled its request.
    fn open() -> WebSocket {
        let mut socket = WebSocket::new(Arc::default());
        let (mut mqtt, mut replies) = (Vec::new(), Vec::new());
        socket
            .received(REQUEST.as_bytes(), &mut mqtt, &mut replies)
            .unwrap();
        socket
    }

    #[test]
    fn a_message_in_fragments_passes_with_a_ping_inside() {
        let mask = [1, 2, 3, 4];
        let mut first = masked(BINARY, b"one ", mask);
        first[0] &= 0x7f;
        let middle = masked(PING, b"there?", mask);
        let last = masked(OpCode::Data(Data::Continue), b"two", mask);
        let (mut socket, mut mqtt, mut replies) = (open(), Vec::new(), Vec::new());
        let bytes = [first, middle, last].concat();
        socket.received(&bytes, &mut mqtt, &mut replies).unwrap();
        assert_eq!(mqtt, b"one two");
        assert_eq!(replies, b"\x8a\x06there?");
    }

    #[test]
    fn frames_that_violate_the_protocol_are_refused_at_their_header() {
        let announced = [0xff; 7];
        for (head, reason) in [
            (&[0x82, 0x01, 7, 7, 7, 7][..], "without mask"),
            (&[0xc2, 0x81, 1, 2, 3, 4], "with an extension"),
            (&[0x81, 0x81, 1, 2, 3, 4], "not binary"),
            (&[0x83, 0x81, 1, 2, 3, 4], "opcode"),
            (&[0x8b, 0x81, 1, 2, 3, 4], "opcode"),
            (&[0x09, 0x81, 1, 2, 3, 4], "fragmented"),
            (
                &[&[0x89, 0xff, 0][..], &announced, &[1, 2, 3, 4]].concat(),
                "too long",
            ),
        ] {
            let (mut socket, mut mqtt, mut replies) = (open(), Vec::new(), Vec::new());
            let wrong = socket.received(head, &mut mqtt, &mut replies).unwrap_err();
            assert!(wrong.contains(reason), "{head:x?}: {wrong}");
            assert!(mqtt.is_empty());
            // Close frame, code 1002.
            assert_eq!(replies, [0x88, 2, 0x03, 0xea]);
        }
    }

    proptest! {
        #[test]
        fn payloads_arrive_whole_however_they_are_cut(
            payloads in prop::collection::vec(prop::collection::vec(any::<u8>(), 1..400), 1..6),
            mask in any::<[u8; 4]>(),
            pieces in prop::collection::vec(1usize..90, 1..20),
        ) {
            let mut stream = REQUEST.as_bytes().to_vec();
            for payload in &payloads {
                stream.extend(masked(BINARY, payload, mask));
                stream.extend(masked(PING, b"there?", mask));
            }
            let (mut socket, mut mqtt, mut replies) = (WebSocket::new(Arc::default()), Vec::new(), Vec::new());
            let mut rest = &stream[..];
            for size in pieces.iter().cycle() {
                let (piece, after) = rest.split_at((*size).min(rest.len()));
                socket.received(piece, &mut mqtt, &mut replies).unwrap();
                rest = after;
                if rest.is_empty() {
                    break;
                }
            }
            prop_assert_eq!(mqtt, payloads.concat());
            let pongs = replies.windows(8).filter(|window| *window == b"\x8a\x06there?").count();
            prop_assert_eq!(pongs, payloads.len());
        }
    }
}
