//! WebSocket, server side: RFC 6455, as far as MQTT needs it (MQTT 5.0, chapter 6). Payloads pass as they come, unassembled.

use super::Origins;
use base64::{Engine, engine::general_purpose::STANDARD};
use ring::digest::{SHA1_FOR_LEGACY_USE_ONLY, digest};
use std::sync::Arc;

/// Frame of binary data.
pub const BINARY: u8 = 2;
const CONTINUATION: u8 = 0;
const CLOSE: u8 = 8;
const PING: u8 = 9;
const PONG: u8 = 10;

/// The longest request for an upgrade that is read, bytes.
const REQUEST: usize = 16 << 10;
/// RFC 6455, section 1.3.
const GUID: &str = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11";

/// One connection, from its HTTP request on.
pub struct WebSocket {
    origins: Arc<Origins>,
    open: bool,
    /// The request, a frame header or the payload of a control frame, as far as it has come.
    partial: Vec<u8>,
    frame: Option<Frame>,
}

struct Frame {
    opcode: u8,
    mask: [u8; 4],
    left: u64,
    passed: usize,
}

impl WebSocket {
    /// A connection that sends its request next.
    pub fn new(origins: Arc<Origins>) -> Self {
        Self {
            origins,
            open: false,
            partial: Vec::new(),
            frame: None,
        }
    }

    /// Takes bytes; appends what is for MQTT to `mqtt` and answers to `replies`.
    pub fn received(
        &mut self,
        bytes: &[u8],
        mqtt: &mut Vec<u8>,
        replies: &mut Vec<u8>,
    ) -> Result<(), String> {
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = match (self.open, &mut self.frame) {
                (false, _) => self.request(rest, replies)?,
                (true, None) => self.header(rest, replies)?,
                (true, Some(_)) => self.payload(rest, mqtt, replies)?,
            };
        }
        Ok(())
    }

    fn request<'a>(&mut self, bytes: &'a [u8], replies: &mut Vec<u8>) -> Result<&'a [u8], String> {
        let before = self.partial.len();
        self.partial.extend_from_slice(bytes);
        // From where the end may begin: a request that comes byte by byte is not searched again and again.
        let from = before.saturating_sub(3);
        let found = self.partial[from..]
            .windows(4)
            .position(|window| window == b"\r\n\r\n");
        let Some(end) = found.map(|place| from + place) else {
            return if self.partial.len() > REQUEST {
                Err("a WebSocket request without end".into())
            } else {
                Ok(&[])
            };
        };
        let request = String::from_utf8_lossy(&self.partial[..end]).into_owned();
        self.partial.clear();
        match answer(&request, &self.origins) {
            Ok(answer) => replies.extend_from_slice(answer.as_bytes()),
            Err((status, wrong)) => {
                let body = format!("{wrong}\n");
                let head =
                    "Connection: close\r\nContent-Type: text/plain\r\nSec-WebSocket-Version: 13";
                replies.extend_from_slice(
                    format!(
                        "HTTP/1.1 {status}\r\n{head}\r\nContent-Length: {}\r\n\r\n{body}",
                        body.len()
                    )
                    .as_bytes(),
                );
                return Err(wrong);
            }
        }
        self.open = true;
        Ok(&bytes[end + 4 - before..])
    }

    fn header<'a>(&mut self, bytes: &'a [u8], replies: &mut Vec<u8>) -> Result<&'a [u8], String> {
        // At most 14 bytes; taken one by one because a header may come in pieces.
        let mut rest = bytes;
        while let Some((&byte, after)) = rest.split_first() {
            self.partial.push(byte);
            rest = after;
            let head = &self.partial;
            if head.len() < 2 {
                continue;
            }
            let extended = match head[1] & 0x7f {
                126 => 2,
                127 => 8,
                _ => 0,
            };
            if head.len() < 2 + extended + 4 {
                continue;
            }
            let (opcode, masked) = (head[0] & 0x0f, head[1] & 0x80 != 0);
            let left = match extended {
                0 => u64::from(head[1] & 0x7f),
                _ => head[2..2 + extended]
                    .iter()
                    .fold(0, |length, &byte| length << 8 | u64::from(byte)),
            };
            let mask = [
                head[2 + extended],
                head[3 + extended],
                head[4 + extended],
                head[5 + extended],
            ];
            let is_control = opcode >= 8;
            let refused = if head[0] & 0x70 != 0 || !masked {
                Some("a WebSocket frame without mask, or with an extension")
            } else if !matches!(opcode, CONTINUATION | BINARY | CLOSE | PING | PONG) {
                Some("a WebSocket frame that is not binary")
            } else if is_control && (left > 125 || head[0] & 0x80 == 0) {
                Some("a WebSocket control frame in parts, or too long")
            } else {
                None
            };
            if let Some(wrong) = refused {
                // 1002: protocol error.
                frame(replies, CLOSE, &1002u16.to_be_bytes());
                return Err(wrong.into());
            }
            self.partial.clear();
            self.frame = Some(Frame {
                opcode,
                mask,
                left,
                passed: 0,
            });
            if left == 0 {
                self.end_of_frame(replies)?;
            }
            return Ok(rest);
        }
        Ok(rest)
    }

    fn payload<'a>(
        &mut self,
        bytes: &'a [u8],
        mqtt: &mut Vec<u8>,
        replies: &mut Vec<u8>,
    ) -> Result<&'a [u8], String> {
        let Some(current) = &mut self.frame else {
            return Ok(bytes);
        };
        let length = usize::try_from(current.left)
            .unwrap_or(usize::MAX)
            .min(bytes.len());
        let (here, rest) = bytes.split_at(length);
        let target = if current.opcode >= 8 {
            &mut self.partial
        } else {
            mqtt
        };
        let (mask, passed) = (current.mask, current.passed);
        target.extend(
            here.iter()
                .enumerate()
                .map(|(place, byte)| byte ^ mask[(passed + place) & 3]),
        );
        current.passed = (passed + length) & 3;
        current.left -= length as u64;
        if current.left == 0 {
            self.end_of_frame(replies)?;
        }
        Ok(rest)
    }

    fn end_of_frame(&mut self, replies: &mut Vec<u8>) -> Result<(), String> {
        let Some(ended) = self.frame.take() else {
            return Ok(());
        };
        let payload = if ended.opcode >= 8 {
            std::mem::take(&mut self.partial)
        } else {
            Vec::new()
        };
        match ended.opcode {
            PING => frame(replies, PONG, &payload),
            CLOSE => {
                frame(replies, CLOSE, &payload);
                return Err(String::new());
            }
            _ => {}
        }
        Ok(())
    }
}

/// Appends a whole frame, unmasked as a server's frames are.
pub fn frame(out: &mut Vec<u8>, opcode: u8, payload: &[u8]) {
    if payload.is_empty() && opcode == BINARY {
        return;
    }
    out.push(0x80 | opcode);
    match payload.len() {
        length @ 0..126 => out.push(length as u8),
        length @ 126..0x1_0000 => {
            out.push(126);
            out.extend((length as u16).to_be_bytes());
        }
        length => {
            out.push(127);
            out.extend((length as u64).to_be_bytes());
        }
    }
    out.extend_from_slice(payload);
}

/// The answer to a request for an upgrade, or the status and what is wrong with the request.
fn answer(request: &str, origins: &Origins) -> Result<String, (&'static str, String)> {
    const BAD: &str = "400 Bad Request";
    let bad = |wrong: &str| Err((BAD, wrong.to_owned()));
    let mut lines = request.split("\r\n");
    if !lines.next().is_some_and(|line| line.starts_with("GET ")) {
        return bad(
            "this port speaks MQTT over WebSocket; a GET request with an upgrade is expected",
        );
    }
    let headers: Vec<(&str, &str)> = lines
        .filter_map(|line| line.split_once(':'))
        .map(|(name, value)| (name.trim(), value.trim()))
        .collect();
    let has = |wanted: &str, token: &str| {
        headers
            .iter()
            .filter(|(name, _)| name.eq_ignore_ascii_case(wanted))
            .flat_map(|(_, value)| value.split(','))
            .any(|value| value.trim().eq_ignore_ascii_case(token))
    };
    let header = |wanted: &str| {
        let mut found = headers.iter();
        found
            .find(|(name, _)| name.eq_ignore_ascii_case(wanted))
            .map(|(_, value)| *value)
    };
    let key = header("Sec-WebSocket-Key");
    let (true, true, Some(key)) = (
        has("Upgrade", "websocket"),
        has("Sec-WebSocket-Version", "13"),
        key,
    ) else {
        return bad(
            "this port speaks MQTT over WebSocket; an upgrade to WebSocket version 13 is expected",
        );
    };
    let accept = STANDARD.encode(digest(
        &SHA1_FOR_LEGACY_USE_ONLY,
        format!("{key}{GUID}").as_bytes(),
    ));
    let protocol = ["mqtt", "mqttv3.1"]
        .into_iter()
        .find(|protocol| has("Sec-WebSocket-Protocol", protocol));
    let Some(protocol) = protocol else {
        return bad("the WebSocket subprotocol `mqtt` is expected");
    };
    let origin = header("Origin");
    if !origins.allow(origin, header("Host")) {
        let page = origin.unwrap_or_default();
        return Err((
            "403 Forbidden",
            format!(
                "pages from {page:?} may not connect; `swarmwright broker --origin {page}` lets them"
            ),
        ));
    }
    Ok(format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept}\r\nSec-WebSocket-Protocol: {protocol}\r\n\r\n"
    ))
}

#[cfg(test)]
mod tests {
    use super::super::fuzz::masked;
    use super::*;
    use proptest::prelude::*;

    const REQUEST: &str = "GET /mqtt HTTP/1.1\r\nHost: x\r\nupgrade: WebSocket\r\nConnection: keep-alive, Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: mqtt\r\n\r\n";

    #[test]
    fn the_key_of_the_standard_is_answered() {
        let answer = answer(REQUEST.trim_end(), &Origins::default()).unwrap();
        assert!(
            answer.contains("Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo=\r\n"),
            "{answer}"
        );
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
