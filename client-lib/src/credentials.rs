//! What a client shows to the server and what it wants to see: a token, and whose certificates it trusts.

use crate::ClientError;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::transport::{Certificate, ClientTlsConfig};
use tonic::{Request, Status};

/// Token and trust; the default has no token and trusts whom the system trusts.
#[derive(Clone, PartialEq, Eq, Default)]
pub struct Credentials {
    /// Sent as `authorization: Bearer ...`. Over `http://` everyone on the way can read it.
    pub bearer_token: Option<String>,
    /// PEM of a certificate that `https://` servers have to be signed by, instead of those the system trusts.
    pub ca_certificate_pem: Option<String>,
}

impl std::fmt::Debug for Credentials {
    /// The token stays out of logs.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Credentials")
            .field("bearer_token", &self.bearer_token.as_ref().map(|_secret| "..."))
            .field("ca_certificate_pem", &self.ca_certificate_pem)
            .finish()
    }
}

impl Credentials {
    /// For `https://` addresses.
    pub(crate) fn tls(&self) -> ClientTlsConfig {
        let config = ClientTlsConfig::new();
        match &self.ca_certificate_pem {
            // Not beside the system's: a bare container has none, and asking for them would fail there.
            Some(pem) => config.ca_certificate(Certificate::from_pem(pem)),
            None => config.with_native_roots(),
        }
    }

    /// What goes with every call.
    pub(crate) fn bearer(&self) -> Result<Bearer, ClientError> {
        let value = |token: &String| {
            let value: Result<MetadataValue<Ascii>, _> = format!("Bearer {token}").parse();
            value.map(|mut value| {
                value.set_sensitive(true);
                value
            })
        };
        self.bearer_token.as_ref().map(value).transpose().map(Bearer).map_err(|_not_ascii| {
            ClientError::Invalid { cause: "a bearer token may have visible ASCII characters only".to_owned() }
        })
    }
}

/// Puts the token into the headers of a call.
#[derive(Debug, Clone)]
pub(crate) struct Bearer(Option<MetadataValue<Ascii>>);

impl Interceptor for Bearer {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(value) = &self.0 {
            request.metadata_mut().insert("authorization", value.clone());
        }
        Ok(request)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_token_does_not_show_and_must_be_sendable() {
        let with =
            |token: &str| Credentials { bearer_token: Some(token.to_owned()), ..Credentials::default() };
        assert!(!format!("{:?}", with("sesame")).contains("sesame"));
        assert!(!format!("{:?}", with("sesame").bearer().unwrap()).contains("sesame"));
        assert!(matches!(with("two\nlines").bearer(), Err(ClientError::Invalid { .. })));
    }
}
