//! What can go wrong between a client and its server.

use earthshine_protocol::v1;
use std::time::Duration;

/// Why there is no session, or no longer one.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ClientError {
    /// Nobody answers at that address, or the address is none. Start the server, or correct the address.
    #[error("cannot reach {uri}: {cause}")]
    Unreachable {
        /// As given.
        uri: String,
        /// What the network says.
        cause: String,
    },
    /// The server answered and said no: unknown world, all sessions taken, missing token.
    #[error("the server refused: {cause}")]
    Refused {
        /// The server's words.
        cause: String,
    },
    /// Client and server have no protocol version in common. Update the older one.
    #[error("no common protocol version (this client speaks {min} to {max}): {cause}", min = earthshine_protocol::PROTOCOL_MIN, max = earthshine_protocol::PROTOCOL_MAX)]
    Version {
        /// The server's words, or what it chose.
        cause: String,
    },
    /// The session ended: network, shutdown, or a fault of the server. Connect again.
    #[error("the session is lost: {cause}")]
    Lost {
        /// What ended it.
        cause: String,
    },
    /// Nothing came in time.
    #[error("no {what} within {} ms", timeout.as_millis())]
    Timeout {
        /// What was waited for.
        what: &'static str,
        /// How long.
        timeout: Duration,
    },
    /// The server sent what no server may send. A bug there, or not an Earthshine server.
    #[error("the server sent something impossible: {cause}")]
    Protocol {
        /// Which message, and what is wrong with it.
        cause: String,
    },
    /// What the caller gave cannot be sent; the session goes on.
    #[error("{cause}")]
    Invalid {
        /// What is wrong with it.
        cause: String,
    },
    /// [`crate::Client::close`] was called.
    #[error("the session was closed")]
    Closed,
}

impl ClientError {
    pub(crate) fn protocol(cause: impl Into<String>) -> Self {
        Self::Protocol { cause: cause.into() }
    }

    pub(crate) fn lost(cause: impl Into<String>) -> Self {
        Self::Lost { cause: cause.into() }
    }

    pub(crate) fn unreachable(uri: &str, error: &dyn std::error::Error) -> Self {
        Self::Unreachable { uri: uri.to_owned(), cause: chain(error) }
    }

    /// A gRPC status that ended a call.
    pub(crate) fn from_status(status: &tonic::Status) -> Self {
        use tonic::Code;
        let cause = format!("{} ({:?})", status.message(), status.code());
        match status.code() {
            Code::Unauthenticated
            | Code::PermissionDenied
            | Code::ResourceExhausted
            | Code::NotFound
            | Code::InvalidArgument
            | Code::FailedPrecondition => Self::Refused { cause },
            // Longer than MESSAGE_BYTES_MAX, or not protobuf.
            Code::OutOfRange | Code::Unimplemented => Self::Protocol { cause },
            _ => Self::Lost { cause },
        }
    }

    /// A fatal `Error` message.
    pub(crate) fn from_wire(error: &v1::Error) -> Self {
        use v1::ErrorCode;
        let cause = error.cause.clone();
        match error.code() {
            ErrorCode::Version => Self::Version { cause },
            ErrorCode::WorldUnknown
            | ErrorCode::HelloExpected
            | ErrorCode::Invalid
            | ErrorCode::Unlikely
            | ErrorCode::Busy
            | ErrorCode::Unauthorised => Self::Refused { cause },
            ErrorCode::Silent | ErrorCode::Draining | ErrorCode::Internal | ErrorCode::Unspecified => {
                Self::Lost { cause }
            }
        }
    }
}

/// `error` and everything that caused it, in one line.
fn chain(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(error.source(), |cause| cause.source());
    causes.fold(error.to_string(), |text, cause| format!("{text}: {cause}"))
}
