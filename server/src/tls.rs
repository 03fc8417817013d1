//! TLS of the gRPC port: two PEM files to an acceptor. The admin port stays plain.
//!
//! Read once at start: a new certificate takes a restart.

use crate::ServerError;
use crate::config::TlsFiles;
use std::path::Path;
use std::sync::Arc;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::{self, PemObject};
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::{self, ServerConfig};

/// What clients must offer: gRPC is HTTP/2.
const ALPN: &[u8] = b"h2";

/// Certificate chain and key, checked against each other.
///
/// # Errors
/// [`ServerError::Tls`] for a file that cannot be read, holds no certificate or key, or does not fit the other.
pub(crate) fn acceptor(files: &TlsFiles) -> Result<TlsAcceptor, ServerError> {
    let chain = CertificateDer::pem_file_iter(&files.cert)
        .and_then(Iterator::collect::<Result<Vec<_>, _>>)
        .map_err(|cause| unreadable("tls.cert", &files.cert, "certificate", &cause))?;
    if chain.is_empty() {
        return Err(unreadable("tls.cert", &files.cert, "certificate", &pem::Error::NoItemsFound));
    }
    let key = PrivateKeyDer::from_pem_file(&files.key)
        .map_err(|cause| unreadable("tls.key", &files.key, "private key", &cause))?;
    let mut config = configuration(chain, key).map_err(|cause| ServerError::Tls {
        key: "tls.key",
        file: files.key.clone(),
        cause: format!("it does not go with the certificate in {:?}: {cause}", files.cert),
    })?;
    config.alpn_protocols = vec![ALPN.to_vec()];
    Ok(TlsAcceptor::from(Arc::new(config)))
}

fn configuration(
    chain: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
) -> Result<ServerConfig, rustls::Error> {
    ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()?
        .with_no_client_auth()
        .with_single_cert(chain, key)
}

fn unreadable(key: &'static str, file: &Path, what: &str, cause: &pem::Error) -> ServerError {
    let cause = match cause {
        pem::Error::NoItemsFound => format!("no {what} in it; it must be PEM"),
        cause => cause.to_string(),
    };
    ServerError::Tls { key, file: file.to_owned(), cause }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcgen::CertifiedKey;

    fn refusal(cert: &str, key: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        let files = TlsFiles { cert: folder.path().join("cert.pem"), key: folder.path().join("key.pem") };
        std::fs::write(&files.cert, cert).unwrap();
        std::fs::write(&files.key, key).unwrap();
        acceptor(&files).map(|_acceptor| ()).unwrap_err().to_string()
    }

    #[test]
    fn bad_files_are_named_with_their_fault() {
        let CertifiedKey { cert, signing_key } =
            rcgen::generate_simple_self_signed(["localhost".into()]).unwrap();
        let other = rcgen::generate_simple_self_signed(["localhost".into()]).unwrap();
        let (cert, key) = (cert.pem(), signing_key.serialize_pem());
        for (message, word) in [
            (refusal("", &key), "no certificate in it"),
            (refusal("-----BEGIN CERTIFICATE-----\n!\n-----END CERTIFICATE-----\n", &key), "cert.pem"),
            (refusal(&cert, &cert), "no private key in it"),
            (refusal(&cert, &other.signing_key.serialize_pem()), "does not go with the certificate"),
        ] {
            assert!(message.contains(word), "{message}");
        }
        let nowhere = TlsFiles { cert: "nowhere.pem".into(), key: "nowhere.pem".into() };
        let message = acceptor(&nowhere).map(|_acceptor| ()).unwrap_err().to_string();
        assert!(message.contains("tls.cert") && message.contains("nowhere.pem"), "{message}");
    }
}
