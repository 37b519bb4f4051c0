//! The listening socket and the life of the server.

use std::future::Future;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;

use tokio::net::TcpListener;

use crate::access::Token;
use crate::connection::Bounded;
use crate::live::Hub;
use crate::routes::{self, Shared};
use crate::source::Source;

/// Reasons why a server cannot run.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The port is taken or not allowed.
    #[error("cannot listen on 127.0.0.1:{port}")]
    Listen {
        /// The wanted port; 0 is any.
        port: u16,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The operating system gave no random numbers, or a connection could not be accepted.
    #[error("cannot serve the dashboard")]
    Serve(#[source] std::io::Error),
}

/// A server that listens on the loopback address and waits to be run.
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    token: Token,
}

impl Server {
    /// Listens on 127.0.0.1 and nowhere else. Port 0 takes a free one.
    ///
    /// # Errors
    /// [`ServerError::Listen`] if the port is taken.
    pub async fn listen(port: u16) -> Result<Self, ServerError> {
        let failed = |source| ServerError::Listen { port, source };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))
            .await
            .map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let token = Token::random().map_err(ServerError::Serve)?;
        Ok(Self {
            listener,
            address,
            token,
        })
    }

    /// Address with the token, which is all that a browser needs.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", self.address, self.token.text())
    }

    /// Address of the socket.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves the source until `end` resolves; open pages are told, and connections are closed.
    ///
    /// # Errors
    /// [`ServerError::Serve`] if connections can no longer be accepted.
    pub async fn run<S: Source>(
        self,
        source: S,
        end: impl Future<Output = ()> + Send + 'static,
    ) -> Result<(), ServerError> {
        let drawing = source.drawing();
        let shared = Arc::new(Shared {
            source: Arc::new(source),
            hub: Arc::new(Hub::new()),
            token: self.token,
            drawing,
        });
        let hub = Arc::clone(&shared.hub);
        let poller = tokio::spawn(Arc::clone(&hub).poll(Arc::clone(&shared.source)));
        let served = axum::serve(Bounded(self.listener), routes::router(&shared))
            .with_graceful_shutdown(async move {
                end.await;
                hub.close();
            })
            .await;
        shared.hub.close();
        // The poller ends by itself; a panic in it has been reported by its own thread.
        let _ = poller.await;
        served.map_err(ServerError::Serve)
    }
}
