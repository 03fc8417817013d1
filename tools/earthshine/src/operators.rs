//! A server's operators' port from the other side: how it solves light, and solving it otherwise.

use clap::Args;
use http_body_util::{BodyExt as _, Full};
use hyper::body::Bytes;
use hyper::{Method, Request, StatusCode};
use hyper_util::rt::TokioIo;
use std::time::Duration;
use tokio::net::TcpStream;

/// A server that has not answered by then does not.
const ANSWER_MAX: Duration = Duration::from_secs(10);

/// Where operators ask.
#[derive(Args)]
pub(crate) struct OperatorArguments {
    /// The server's operators' port, HOST:PORT.
    #[arg(long, env = "EARTHSHINE_ADMIN", default_value = "127.0.0.1:7462", value_name = "ADDRESS")]
    pub(crate) admin: String,
}

/// Why an operators' port did not do as asked.
#[derive(Debug, thiserror::Error)]
pub(crate) enum OperatorsError {
    /// Nobody there, or nobody who speaks HTTP.
    #[error(
        "the operators' port {address}: {cause}; is a server there? `serve` prints the address, --admin names it"
    )]
    NoAnswer {
        /// HOST:PORT.
        address: String,
        /// What happened.
        cause: String,
    },
    /// The server will not.
    #[error("the operators' port {address} refuses ({status}): {cause}")]
    Refused {
        /// HOST:PORT.
        address: String,
        /// As HTTP says it.
        status: StatusCode,
        /// As the server says it.
        cause: String,
    },
}

/// An operators' port and the way in.
#[derive(Debug)]
pub(crate) struct Operators {
    /// HOST:PORT.
    pub(crate) address: String,
    /// What a server with a token asks for.
    pub(crate) bearer_token: Option<String>,
}

impl Operators {
    /// `[engine.solver]` as the server has it.
    pub(crate) async fn solver(&self) -> Result<String, OperatorsError> {
        self.ask(Method::GET, String::new()).await
    }

    /// Changes what `wish` (TOML) names of it; returns all of it.
    pub(crate) async fn change_solver(&self, wish: &str) -> Result<String, OperatorsError> {
        self.ask(Method::PUT, wish.to_owned()).await
    }

    async fn ask(&self, method: Method, body: String) -> Result<String, OperatorsError> {
        let no_answer = |cause: String| OperatorsError::NoAnswer { address: self.address.clone(), cause };
        let asking = async {
            let stream = TcpStream::connect(&self.address).await?;
            let (mut sender, connection) =
                hyper::client::conn::http1::handshake(TokioIo::new(stream)).await?;
            let connection = tokio::spawn(connection);
            let mut request = Request::builder().method(method).uri("/solver").header("host", &self.address);
            if let Some(token) = &self.bearer_token {
                request = request.header("authorization", format!("Bearer {token}"));
            }
            let answer = sender.send_request(request.body(Full::new(Bytes::from(body)))?).await?;
            let status = answer.status();
            let text = answer.into_body().collect().await?.to_bytes();
            connection.abort();
            anyhow::Ok((status, String::from_utf8_lossy(&text).trim_end().to_owned()))
        };
        let answer = tokio::time::timeout(ANSWER_MAX, asking).await;
        let answer =
            answer.map_err(|_elapsed| no_answer(format!("no answer in {} s", ANSWER_MAX.as_secs())))?;
        match answer.map_err(|error| no_answer(format!("{error:#}")))? {
            (StatusCode::OK, text) => Ok(text),
            (status, cause) => Err(OperatorsError::Refused { address: self.address.clone(), status, cause }),
        }
    }
}
