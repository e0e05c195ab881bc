//! Byte stream to the broker: TCP, TLS or WebSocket, all with `TCP_NODELAY`, or a Unix socket.
//!
//! Without `TCP_NODELAY`, the several small messages of a step would suffer from Nagle's algorithm and delayed
//! acknowledgements, 40 ms each. In the other direction this is up to the broker; immediate acknowledgements
//! (`acknowledge`) compensate for it.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream as StdStream, ToSocketAddrs};
use std::time::Duration;

use mio::net::TcpStream;
use rustls::{ClientConnection, StreamOwned};
use swarmwright_sockets::Socket;
use tungstenite::WebSocket;

use crate::settings::{Scheme, Settings};
#[cfg(unix)]
use crate::unix;
use crate::{ConnectError, tls};

/// A socket with or without TLS.
enum Channel {
    Plain(Socket),
    Tls(Box<StreamOwned<ClientConnection, Socket>>),
}

impl Channel {
    fn socket(&mut self) -> &mut Socket {
        match self {
            Self::Plain(stream) => stream,
            Self::Tls(stream) => &mut stream.sock,
        }
    }
}

impl Read for Channel {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Plain(stream) => stream.read(buffer),
            Self::Tls(stream) => stream.read(buffer),
        }
    }
}

impl Write for Channel {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Plain(stream) => stream.write(bytes),
            Self::Tls(stream) => stream.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(stream) => stream.flush(),
            Self::Tls(stream) => stream.flush(),
        }
    }
}

/// MQTT in binary WebSocket messages, whose boundaries have no meaning (MQTT 5, section 6).
struct WebSocketStream {
    socket: WebSocket<Channel>,
    /// Part of the last message that did not fit into the reader's buffer.
    rest: tungstenite::Bytes,
}

impl WebSocketStream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.rest.is_empty() {
            match self.socket.read().map_err(to_io)? {
                tungstenite::Message::Binary(bytes) => self.rest = bytes,
                tungstenite::Message::Close(_) => return Ok(0),
                _ => {}
            }
        }
        let count = self.rest.len().min(buffer.len());
        buffer[..count].copy_from_slice(&self.rest.split_to(count));
        Ok(count)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // The WebSocket buffers bytes that the socket does not accept now; wait only if the buffer is full.
        match self
            .socket
            .write(tungstenite::Message::binary(bytes.to_vec()))
        {
            Ok(()) => Ok(bytes.len()),
            Err(tungstenite::Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => {
                Ok(bytes.len())
            }
            Err(error) => Err(to_io(error)),
        }
    }
}

fn to_io(error: tungstenite::Error) -> io::Error {
    match error {
        tungstenite::Error::Io(error) => error,
        tungstenite::Error::ConnectionClosed | tungstenite::Error::AlreadyClosed => {
            ErrorKind::ConnectionAborted.into()
        }
        other => io::Error::other(other),
    }
}

enum Stream {
    Raw(Channel),
    WebSocket(Box<WebSocketStream>),
}

/// The byte stream to the broker.
pub(crate) struct Transport(Stream);

impl Transport {
    /// Connects and completes all handshakes below MQTT. The socket blocks, with the settings' time-out.
    pub fn connect(settings: &Settings) -> Result<Self, ConnectError> {
        let url = settings.url.to_string();
        #[cfg(unix)]
        if settings.url.scheme == Scheme::Unix {
            let socket = unix::connect(settings)?;
            return Ok(Self(Stream::Raw(Channel::Plain(socket))));
        }
        let stream = connect_tcp(settings).map_err(|error| ConnectError::NoBroker {
            url: url.clone(),
            reason: error.to_string(),
        })?;
        let secure = matches!(settings.url.scheme, Scheme::Mqtts | Scheme::Wss);
        let channel = if secure {
            Channel::Tls(Box::new(tls::connect(settings, stream)?))
        } else {
            Channel::Plain(stream)
        };
        if matches!(settings.url.scheme, Scheme::Mqtt | Scheme::Mqtts) {
            return Ok(Self(Stream::Raw(channel)));
        }
        let not_mqtt = |reason: String| ConnectError::NoMqtt {
            url: url.clone(),
            reason,
        };
        let request = tungstenite::ClientRequestBuilder::new(
            url.parse().map_err(|error| not_mqtt(format!("{error}")))?,
        )
        .with_sub_protocol("mqtt");
        let (socket, _) = tungstenite::client(request, channel).map_err(|error| match &error {
            tungstenite::HandshakeError::Failure(tungstenite::Error::Io(inner)) => {
                tls::refused(inner, settings).unwrap_or_else(|| not_mqtt(error.to_string()))
            }
            _ => not_mqtt(error.to_string()),
        })?;
        Ok(Self(Stream::WebSocket(Box::new(WebSocketStream {
            socket,
            rest: tungstenite::Bytes::new(),
        }))))
    }

    /// Returns the socket, for registration with the event loop.
    pub fn socket(&mut self) -> &mut Socket {
        match &mut self.0 {
            Stream::Raw(channel) => channel.socket(),
            Stream::WebSocket(stream) => stream.socket.get_mut().socket(),
        }
    }

    /// Sets how long further reads wait.
    pub fn set_read_timeout(&mut self, timeout: Duration) -> io::Result<()> {
        self.socket().options().set_read_timeout(Some(timeout))
    }

    /// Makes further reads and writes return at once.
    pub fn set_nonblocking(&mut self) -> io::Result<()> {
        self.socket().options().set_nonblocking(true)
    }

    /// Makes the system acknowledge received bytes now, instead of with the next bytes sent or after 40 ms.
    ///
    /// A broker with Nagle's algorithm sends nothing more until then. Supported on Linux only.
    pub fn acknowledge(&mut self) {
        if let Err(error) = self.socket().acknowledge(true) {
            log::debug!("the system does not acknowledge at once: {error}");
        }
    }

    /// Makes the system delay acknowledgements until the next bytes are sent, or for 40 ms. Supported on Linux only.
    pub fn acknowledge_late(&mut self) {
        if let Err(error) = self.socket().acknowledge(false) {
            log::debug!("the system does not acknowledge late: {error}");
        }
    }

    /// Returns whether a read that does not fill the buffer has emptied the socket.
    pub fn short_read_is_all(&self) -> bool {
        matches!(self.0, Stream::Raw(Channel::Plain(_)))
    }

    /// Reads available bytes; returns 0 if the broker has closed the connection.
    pub fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match &mut self.0 {
            Stream::Raw(channel) => channel.read(buffer),
            Stream::WebSocket(stream) => stream.read(buffer),
        }
    }

    /// Writes as many bytes as the socket accepts.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.0 {
            Stream::Raw(channel) => channel.write(bytes),
            Stream::WebSocket(stream) => stream.write(bytes),
        }
    }

    /// Sends bytes buffered by lower layers; `WouldBlock` if it must be called again.
    pub fn flush(&mut self) -> io::Result<()> {
        match &mut self.0 {
            Stream::Raw(channel) => channel.flush(),
            Stream::WebSocket(stream) => stream.socket.flush().map_err(to_io),
        }
    }
}

fn connect_tcp(settings: &Settings) -> io::Result<Socket> {
    let addresses = (settings.url.host.as_str(), settings.url.port).to_socket_addrs()?;
    let mut last = io::Error::new(ErrorKind::NotFound, "the host name has no address");
    for address in addresses {
        match StdStream::connect_timeout(&address, settings.timeout) {
            Ok(stream) => {
                stream.set_nodelay(true)?;
                stream.set_read_timeout(Some(settings.timeout))?;
                stream.set_write_timeout(Some(settings.timeout))?;
                return Ok(Socket::Tcp(TcpStream::from_std(stream)));
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}
