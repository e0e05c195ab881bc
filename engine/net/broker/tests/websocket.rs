//! MQTT over WebSocket with an independent client library.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests"
)]

use crate::common;

use common::{CONNACK, Client, Hello, in_time};
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::Duration;
use swarmwright_broker::{Broker, Config};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Bytes, Message, WebSocket};

/// A WebSocket as a stream of bytes, which writes frames of `piece` bytes.
struct Framed {
    socket: WebSocket<TcpStream>,
    piece: usize,
    rest: Bytes,
}

impl Read for Framed {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        while self.rest.is_empty() {
            match self.socket.read() {
                Ok(Message::Binary(bytes)) => self.rest = bytes,
                Ok(Message::Close(_)) | Err(tungstenite::Error::ConnectionClosed) => return Ok(0),
                Ok(_) => {}
                Err(error) => return Err(io::Error::other(error)),
            }
        }
        let count = self.rest.len().min(into.len());
        into[..count].copy_from_slice(&self.rest.split_to(count));
        Ok(count)
    }
}

impl Write for Framed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        for piece in bytes.chunks(self.piece) {
            let message = Message::Binary(Bytes::copy_from_slice(piece));
            self.socket.write(message).map_err(io::Error::other)?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.socket.flush().map_err(io::Error::other)
    }
}

fn start() -> Broker {
    Broker::start(&Config {
        websocket_port: Some(0),
        ..Config::default()
    })
    .unwrap()
}

fn connect(broker: &Broker, piece: usize) -> Client<Framed> {
    let url = format!("{}/mqtt", broker.websocket_url().unwrap());
    let mut request = url.into_client_request().unwrap();
    request
        .headers_mut()
        .insert("Sec-WebSocket-Protocol", "mqtt".parse().unwrap());
    let stream = TcpStream::connect(("127.0.0.1", broker.websocket_port().unwrap())).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    let (socket, answer) = tungstenite::client(request, stream).unwrap();
    assert_eq!(answer.headers()["Sec-WebSocket-Protocol"], "mqtt");
    let framed = Framed {
        socket,
        piece,
        rest: Bytes::new(),
    };
    let mut client = Client::over(framed, &Hello::default());
    assert_eq!(client.expect(CONNACK)[1], 0);
    client
}

#[test]
fn websocket_and_tcp_clients_talk_to_each_other() {
    in_time(|| {
        let broker = start();
        let mut plain = Client::join(&broker, &Hello::default());
        plain.subscribe("to/tcp", 0);
        // Frames may end anywhere; MQTT packets continue in the next one.
        for piece in [1, 7, 100, 1 << 20] {
            let mut web = connect(&broker, piece);
            web.subscribe("to/web", 0);
            for size in [0, 1, 125, 126, 5000, 70_000] {
                let payload = vec![b'x'; size];
                web.publish("to/tcp", false, &payload);
                assert_eq!(plain.hear().3, payload);
                plain.publish("to/web", false, &payload);
                assert_eq!(web.hear().3, payload);
            }
        }
    });
}

#[test]
fn a_ping_is_answered_and_a_close_is_too() {
    in_time(|| {
        let broker = start();
        let mut web = connect(&broker, 1000);
        let socket = &mut web.stream.socket;
        socket
            .send(Message::Ping(Bytes::from_static(b"there?")))
            .unwrap();
        assert_eq!(
            socket.read().unwrap(),
            Message::Pong(Bytes::from_static(b"there?"))
        );
        socket.close(None).unwrap();
        assert!(matches!(socket.read(), Ok(Message::Close(_))));
    });
}

#[test]
fn requests_without_an_upgrade_are_refused_with_the_reason() {
    in_time(|| {
        let broker = start();
        for request in [
            "GET / HTTP/1.1\r\nHost: x\r\n\r\n",
            "POST /mqtt HTTP/1.1\r\n\r\n",
        ] {
            let mut stream =
                TcpStream::connect(("127.0.0.1", broker.websocket_port().unwrap())).unwrap();
            stream
                .set_read_timeout(Some(Duration::from_secs(20)))
                .unwrap();
            stream.write_all(request.as_bytes()).unwrap();
            let mut answer = String::new();
            stream.read_to_string(&mut answer).unwrap();
            assert!(answer.starts_with("HTTP/1.1 400 "), "{answer}");
            assert!(answer.contains("MQTT over WebSocket"), "{answer}");
        }
    });
}
