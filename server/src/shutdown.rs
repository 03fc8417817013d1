//! How the service ends: one signal, then a drain in a fixed order within one deadline.
//!
//! Sessions first (clients get their goodbye), then the loader (nobody asks for tiles any more), then
//! the engine (nothing reaches it any more). Start at [`signal`] and `Deadline`.

use crate::ServerError;
use std::time::Duration;
use tokio::time::Instant;

/// Listens for signals from this call on; what it gives resolves on the first SIGTERM or SIGINT (ctrl-c). To be called before
/// anybody learns that the service is there: a signal that comes earlier ends the process without a drain.
///
/// # Errors
/// [`ServerError::System`] if the system refuses the handlers.
pub fn signal() -> Result<impl Future<Output = ()>, ServerError> {
    let system = |cause| ServerError::System { what: "a signal handler", cause };
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let mut terminate = signal(SignalKind::terminate()).map_err(system)?;
        let mut interrupt = signal(SignalKind::interrupt()).map_err(system)?;
        Ok(async move {
            tokio::select! {
                _ = terminate.recv() => tracing::info!("SIGTERM: draining"),
                _ = interrupt.recv() => tracing::info!("SIGINT: draining"),
            }
        })
    }
    #[cfg(windows)]
    {
        let mut interrupt = tokio::signal::windows::ctrl_c().map_err(system)?;
        Ok(async move {
            interrupt.recv().await;
        })
    }
}

/// The moment by which a drain has to be over, shared by all its stages.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Deadline {
    at: Instant,
    limit: Duration,
}

impl Deadline {
    /// `limit` from now.
    pub(crate) fn after(limit: Duration) -> Self {
        Self { at: Instant::now() + limit, limit }
    }

    /// Waits for `stage` for what is left of the time.
    pub(crate) async fn wait<T>(
        &self,
        stage: &'static str,
        ending: impl Future<Output = T>,
    ) -> Result<T, ServerError> {
        let limit = self.limit;
        // Unfinished work is dropped with the future.
        let ended = tokio::time::timeout_at(self.at, ending).await.ok();
        ended.ok_or(ServerError::DrainTimeout { stage, limit })
    }

    /// The same for a thread, which cannot be dropped: past the deadline it is left to the end of the process.
    pub(crate) async fn join(
        &self,
        stage: &'static str,
        thread: std::thread::JoinHandle<()>,
    ) -> Result<std::thread::Result<()>, ServerError> {
        while !thread.is_finished() {
            self.wait(stage, tokio::time::sleep(JOIN_POLL)).await?;
        }
        Ok(thread.join())
    }
}

/// How often a thread is asked whether it has ended.
const JOIN_POLL: Duration = Duration::from_millis(2);

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn stages_share_one_deadline() {
        let deadline = Deadline::after(Duration::from_millis(40));
        deadline.wait("sessions", tokio::time::sleep(Duration::from_millis(1))).await.unwrap();
        let thread =
            std::thread::Builder::new().spawn(|| std::thread::sleep(Duration::from_millis(300))).unwrap();
        let error = deadline.join("the engine", thread).await.unwrap_err();
        assert_eq!(error.exit_code(), 11);
        assert!(error.to_string().contains("the engine did not end within 40ms"), "{error}");
    }
}
