//! Which server a subcommand connects to, and what it shows there.

use anyhow::Context as _;
use clap::Args;
use earthshine_client::Credentials;
use std::path::PathBuf;

/// A server and the way in.
#[derive(Args)]
pub(crate) struct ConnectArguments {
    /// Server to connect to, http:// or https://.
    #[arg(long, env = "EARTHSHINE_SERVER", default_value = "http://127.0.0.1:7461")]
    pub(crate) server: String,
    /// Token the server asks for; prefer the environment, flags show in process lists.
    #[arg(long, env = "EARTHSHINE_BEARER_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    bearer_token: Option<String>,
    /// PEM file of a certificate that the server's has to be signed by, instead of those the system trusts.
    #[arg(long, value_name = "FILE")]
    ca_certificate: Option<PathBuf>,
}

impl ConnectArguments {
    /// Token and trust; the certificate file is read here.
    pub(crate) fn credentials(&self) -> anyhow::Result<Credentials> {
        let read = |file: &PathBuf| {
            std::fs::read_to_string(file).with_context(|| format!("--ca-certificate {}", file.display()))
        };
        let ca_certificate_pem = self.ca_certificate.as_ref().map(read).transpose()?;
        Ok(Credentials { bearer_token: self.bearer_token.clone(), ca_certificate_pem })
    }
}
