//! The same client for programs without tokio: it brings one background thread of its own.

use crate::{Answer, Camera, ClientError, ClientOptions, Light, Lights, Session, Statistics, World};
use std::{sync::Arc, time::Duration};
use tokio::runtime::{Builder, Runtime};

/// One session and the thread that serves it. Must not be made or waited on inside an async runtime.
#[derive(Debug)]
pub struct Client {
    /// Dropped before the runtime, so that its tasks have somewhere to end.
    inner: Option<crate::Client>,
    runtime: Option<Runtime>,
}

/// Asks the server at `uri` for the world that the options name.
///
/// # Errors
/// As [`crate::world()`], and [`ClientError::Invalid`] where the system gives no thread.
pub fn world(uri: &str, options: &ClientOptions) -> Result<World, ClientError> {
    runtime()?.block_on(crate::world(uri, options))
}

fn runtime() -> Result<Runtime, ClientError> {
    Builder::new_multi_thread()
        .worker_threads(1)
        .thread_name("earthshine-client")
        .enable_all()
        .build()
        .map_err(|error| ClientError::Invalid { cause: format!("no thread for the client: {error}") })
}

impl Client {
    /// As [`crate::Client::connect`]; waits until the session is open.
    ///
    /// # Errors
    /// As there, and [`ClientError::Invalid`] where the system gives no thread.
    pub fn connect(uri: &str, options: ClientOptions) -> Result<Self, ClientError> {
        let runtime = runtime()?;
        let inner = runtime.block_on(crate::Client::connect(uri, options))?;
        Ok(Self { inner: Some(inner), runtime: Some(runtime) })
    }

    fn inner(&self) -> &crate::Client {
        self.inner.as_ref().expect("taken only by close and drop, after which there is no self")
    }

    /// What the server said in its welcome.
    #[must_use]
    pub fn session(&self) -> &Session {
        self.inner().session()
    }

    /// As [`crate::Client::set_camera`]: does not wait.
    ///
    /// # Errors
    /// As there.
    pub fn set_camera(&self, camera: Camera) -> Result<u64, ClientError> {
        self.inner().set_camera(camera)
    }

    /// As [`crate::Client::set_lights`]: does not wait.
    ///
    /// # Errors
    /// As there.
    pub fn set_lights(&self, lights: &Lights) -> Result<(), ClientError> {
        self.inner().set_lights(lights)
    }

    /// The newest whole state, at once.
    #[must_use]
    pub fn light(&self) -> Arc<Light> {
        self.inner().light()
    }

    /// Waits at most `timeout` for a state newer than the last one this returned.
    ///
    /// # Errors
    /// [`ClientError::Timeout`] where none came, after which the session goes on; whatever ended the session.
    ///
    /// # Panics
    /// Inside an async runtime.
    pub fn next_light(&mut self, timeout: Duration) -> Result<Arc<Light>, ClientError> {
        let (Some(runtime), Some(inner)) = (&self.runtime, &mut self.inner) else {
            return Err(ClientError::Closed);
        };
        runtime
            .block_on(async { tokio::time::timeout(timeout, inner.next_light()).await })
            .unwrap_or(Err(ClientError::Timeout { what: "light", timeout }))
    }

    /// Counters so far.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        self.inner().statistics()
    }

    /// As [`crate::Client::take_answers`].
    #[must_use]
    pub fn take_answers(&self) -> Vec<Answer> {
        self.inner().take_answers()
    }

    /// Why the session is over; `None` while it is not.
    #[must_use]
    pub fn ended(&self) -> Option<ClientError> {
        self.inner().ended()
    }

    /// As [`crate::Client::close`].
    pub fn close(mut self) {
        if let (Some(runtime), Some(inner)) = (&self.runtime, self.inner.take()) {
            runtime.block_on(inner.close());
        }
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        drop(self.inner.take());
        if let Some(runtime) = self.runtime.take() {
            // Without waiting: a game's thread drops it.
            runtime.shutdown_background();
        }
    }
}
