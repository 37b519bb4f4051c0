//! Connections whose requests have to come to their end: one that stops in the middle is answered and closed.
//!
//! A client may send less than a whole request: curl 7.88 does so where a long address leaves no room for its cookie. It would wait
//! for an answer for ever, and keep a connection open.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use axum::serve::Listener;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::{Instant, Sleep, sleep};

/// Time from the first byte of a request's head to its last.
const LIMIT: Duration = Duration::from_secs(5);
/// End of a request's head. The pages send no bodies, so that it is the end of the request.
const END: [u8; 4] = *b"\r\n\r\n";
const TIMED_OUT: &[u8] =
    b"HTTP/1.1 408 Request Timeout\r\nconnection: close\r\ncontent-length: 0\r\n\r\n";

/// A listener whose connections have a limit for each request.
pub struct Bounded(pub TcpListener);

impl Listener for Bounded {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        let (stream, address) = Listener::accept(&mut self.0).await;
        (Connection::new(stream), address)
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.0.local_addr()
    }
}

/// How far the request on a connection has come.
#[derive(Debug, Default)]
struct Head {
    /// The last bytes, of this request or the one before.
    last: [u8; 4],
    is_open: bool,
}

impl Head {
    /// Takes bytes up. Returns whether they begin a request.
    fn take(&mut self, bytes: &[u8]) -> bool {
        let begins = !bytes.is_empty() && !self.is_open;
        for byte in bytes {
            self.last.rotate_left(1);
            self.last[3] = *byte;
        }
        if !bytes.is_empty() {
            self.is_open = self.last != END;
        }
        begins
    }
}

/// A connection that is closed if a request stops in the middle.
pub struct Connection {
    stream: TcpStream,
    head: Head,
    limit: Pin<Box<Sleep>>,
}

impl Connection {
    fn new(stream: TcpStream) -> Self {
        Self {
            stream,
            head: Head::default(),
            limit: Box::pin(sleep(LIMIT)),
        }
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        if let Poll::Ready(read) = Pin::new(&mut self.stream).poll_read(context, buffer) {
            if self.head.take(&buffer.filled()[before..]) {
                self.limit.as_mut().reset(Instant::now() + LIMIT);
            }
            return Poll::Ready(read);
        }
        if !self.head.is_open {
            return Poll::Pending;
        }
        ready!(self.limit.as_mut().poll(context));
        // A client that has gone needs no answer.
        let _ = self.stream.try_write(TIMED_OUT);
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }
}

impl AsyncWrite for Connection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(context, parts)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_open_from_its_first_byte_to_its_empty_line() {
        let mut head = Head::default();
        assert!(!head.take(b"") && !head.is_open);
        assert!(head.take(b"GET / HTTP/1.1\r\nHost: a\r") && head.is_open);
        assert!(!head.take(b"\n\r") && head.is_open);
        assert!(!head.take(b"\n") && !head.is_open);
        assert!(head.take(b"G") && head.is_open, "the next one begins");
    }
}
