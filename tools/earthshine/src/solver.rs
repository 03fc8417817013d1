//! `earthshine solver`: how a running server solves light, and solving it otherwise without a restart.

use crate::exit_code::WrongUse;
use crate::operators::{OperatorArguments, Operators};
use crate::output::out;
use anyhow::Context as _;
use clap::Args;

/// Arguments of `earthshine solver`.
#[derive(Args)]
#[command(after_help = "Examples:
  earthshine solver                                  (what is in use)
  earthshine solver hybrid,matrix                    (level 0, and all coarser ones)
  earthshine solver alias --set samples_per_row=64 --set history_weight=0.99")]
pub(crate) struct SolverArguments {
    /// Solvers by level, finest first: matrix, gather, alias, cdf, progressive or hybrid.
    #[arg(value_delimiter = ',')]
    names: Vec<String>,
    /// Any other key of [engine.solver] (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    operators: OperatorArguments,
    /// Token the server asks for; prefer the environment, flags show in process lists.
    #[arg(long, env = "EARTHSHINE_BEARER_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    bearer_token: Option<String>,
}

/// The TOML that puts `names` in charge.
pub(crate) fn by_level<S: AsRef<str>>(names: &[S]) -> String {
    let quoted: Vec<String> = names.iter().map(|name| format!("{:?}", name.as_ref())).collect();
    format!("by_level = [{}]\n", quoted.join(", "))
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &SolverArguments) -> anyhow::Result<()> {
    if arguments.set.iter().any(|setting| !setting.contains('=')) {
        return Err(WrongUse("--set needs KEY=VALUE").into());
    }
    let names = &arguments.names;
    let mut wish = if names.is_empty() { String::new() } else { by_level(names) };
    wish.extend(arguments.set.iter().map(|setting| format!("{setting}\n")));
    let operators = Operators {
        address: arguments.operators.admin.clone(),
        bearer_token: arguments.bearer_token.clone(),
    };
    let runtime = tokio::runtime::Runtime::new().context("the asynchronous runtime could not start")?;
    let settings = runtime.block_on(async {
        if wish.is_empty() { operators.solver().await } else { operators.change_solver(&wish).await }
    })?;
    out!("{}", settings.trim_end());
    Ok(())
}
