//! Who may come in, and whether what is said there stays between the two.

use crate::world::{Raw, Service, within};
use earthshine_client::{Camera, Client, ClientError, ClientOptions, Credentials, Vec3};
use earthshine_protocol::v1::ErrorCode;
use earthshine_server::config::TlsFiles;
use std::time::Duration;
use tempfile::TempDir;
use tokio::io::AsyncReadExt;
use tokio::net::TcpStream;

fn options(token: Option<&str>, ca_certificate_pem: Option<&str>) -> ClientOptions {
    let credentials = Credentials {
        bearer_token: token.map(str::to_owned),
        ca_certificate_pem: ca_certificate_pem.map(str::to_owned),
    };
    ClientOptions { credentials, connect_timeout: Duration::from_secs(5), ..ClientOptions::default() }
}

/// A certificate for `localhost`, signed by itself.
struct Certificate {
    pem: String,
    files: TlsFiles,
    _folder: TempDir,
}

fn certificate() -> Certificate {
    let folder = tempfile::tempdir().unwrap();
    let made = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
    let files = TlsFiles { cert: folder.path().join("cert.pem"), key: folder.path().join("key.pem") };
    let pem = made.cert.pem();
    std::fs::write(&files.cert, &pem).unwrap();
    std::fs::write(&files.key, made.signing_key.serialize_pem()).unwrap();
    Certificate { pem, files, _folder: folder }
}

#[tokio::test]
async fn without_the_token_nobody_enters() {
    let service = Service::start(|config| config.bearer_token.0 = "sesame".to_owned()).await;
    let mut raw = Raw::open(&service.uri).await;
    assert_eq!(raw.hear_end().await.code(), ErrorCode::Unauthorised);
    for wrong in [None, Some("sesam")] {
        let wrong = options(wrong, None);
        let error = Client::connect(&service.uri, wrong.clone()).await.unwrap_err();
        assert!(matches!(&error, ClientError::Refused { cause } if cause.contains("token")), "{error}");
        let error = earthshine_client::world(&service.uri, &wrong).await.unwrap_err();
        assert!(matches!(&error, ClientError::Refused { cause } if cause.contains("token")), "{error}");
    }
    let right = options(Some("sesame"), None);
    earthshine_client::world(&service.uri, &right).await.unwrap();
    Client::connect(&service.uri, right).await.unwrap().close().await;
    service.stop().await;
}

#[tokio::test]
async fn light_comes_over_tls_to_those_who_trust_the_certificate() {
    let certificate = certificate();
    let service = Service::start(|config| config.tls = Some(certificate.files.clone())).await;
    let uri = service.uri.replace("http://127.0.0.1", "https://localhost");
    let mut client = Client::connect(&uri, options(None, Some(&certificate.pem))).await.unwrap();
    client.set_camera(Camera { position: Vec3::splat(5.0), forward: Vec3::X, velocity: Vec3::ZERO }).unwrap();
    within(client.next_light()).await.unwrap();
    client.close().await;
    // Whoever trusts somebody else, or nobody in particular, and whoever speaks without TLS, is not let in.
    let another = self::certificate();
    for (uri, trusted) in [(&uri, Some(another.pem.as_str())), (&uri, None), (&service.uri, None)] {
        let error = Client::connect(uri, options(None, trusted)).await.unwrap_err();
        assert!(
            matches!(error, ClientError::Unreachable { .. } | ClientError::Lost { .. }),
            "{uri}: {error}"
        );
    }
    service.stop().await;
}

#[tokio::test]
async fn a_peer_that_never_shakes_hands_is_hung_up_on_and_holds_nobody_up() {
    let certificate = certificate();
    let service = Service::start(|config| {
        config.tls = Some(certificate.files.clone());
        config.hello_timeout_s = 0.2;
    })
    .await;
    let mut silent = TcpStream::connect(&service.address).await.unwrap();
    let uri = service.uri.replace("http://127.0.0.1", "https://localhost");
    let client = Client::connect(&uri, options(None, Some(&certificate.pem))).await.unwrap();
    assert_eq!(within(silent.read(&mut [0; 16])).await.unwrap(), 0, "hung up on");
    assert_eq!(service.metric("earthshine_connections_silent_total").await, 1.0);
    client.close().await;
    service.stop().await;
}
