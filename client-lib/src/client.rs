//! The async client: a session with two background tasks, one each way.

use crate::{
    Answer, Camera, ClientError, ClientOptions, Light, Lights, Session, Statistics,
    assembly::Assembly,
    session::{Shared, greet},
};
use std::{
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::{sync::watch, task::JoinHandle};

/// How long [`Client::close`] waits for the server to end the stream.
const FAREWELL: Duration = Duration::from_secs(1);

/// One session. Dropping it leaves the server without waiting.
#[derive(Debug)]
pub struct Client {
    session: Session,
    shared: Arc<Shared>,
    light: watch::Receiver<Arc<Light>>,
    receiver: JoinHandle<()>,
}

impl Client {
    /// Connects to `uri` (`http://host:port`) and opens a session.
    ///
    /// # Errors
    /// [`ClientError::Unreachable`], [`ClientError::Refused`], [`ClientError::Version`], [`ClientError::Timeout`],
    /// [`ClientError::Lost`], [`ClientError::Protocol`]; [`ClientError::Invalid`] for names that are too long.
    pub async fn connect(uri: &str, options: ClientOptions) -> Result<Self, ClientError> {
        let (session, streams) = greet(uri, &options).await?;
        let shared = Arc::new(Shared::default());
        let (front, light) = watch::channel(Arc::new(Light::default()));
        let receiver = {
            let shared = Arc::clone(&shared);
            let assembly = Assembly::new(options.dims_max);
            tokio::spawn(async move { shared.receive(assembly, streams.from_server, front).await })
        };
        tokio::spawn({
            let shared = Arc::clone(&shared);
            async move { shared.outbox.pump(streams.to_server).await }
        });
        tracing::debug!(session = session.id, world = %session.world, "session open");
        Ok(Self { session, shared, light, receiver })
    }

    /// What the server said in its welcome.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Says where light is wanted, and gives the camera a number that [`Light::camera_sequence`] will reach. Does
    /// not wait; a camera that has not been sent yet is replaced.
    ///
    /// # Errors
    /// [`ClientError::Invalid`] for numbers that are not finite; whatever ended the session.
    pub fn set_camera(&self, camera: Camera) -> Result<u64, ClientError> {
        self.check()?;
        // Checked before it is numbered: a refused camera leaves no gap.
        let mut update = camera.to_wire(0)?;
        let mut counters = self.shared.counters();
        update.sequence = counters.camera(Instant::now());
        // Under the lock of the counters, so that the newest number is also the newest camera.
        self.shared.outbox.set_camera(update);
        Ok(update.sequence)
    }

    /// Replaces all lights of the world for the session. Does not wait.
    ///
    /// # Errors
    /// [`ClientError::Invalid`] for too many lights; whatever ended the session. Lights that the server cannot
    /// accept come back as [`Statistics::warning`].
    pub fn set_lights(&self, lights: &Lights) -> Result<(), ClientError> {
        self.check()?;
        self.shared.outbox.set_lights(lights.to_wire()?);
        Ok(())
    }

    /// The newest whole state, at once; the empty one before the first. It stays readable after the session ended.
    #[must_use]
    pub fn light(&self) -> Arc<Light> {
        Arc::clone(&self.light.borrow())
    }

    /// Waits for a state newer than the last one this returned.
    ///
    /// # Errors
    /// Whatever ended the session.
    pub async fn next_light(&mut self) -> Result<Arc<Light>, ClientError> {
        match self.light.changed().await {
            Ok(()) => Ok(Arc::clone(&self.light.borrow_and_update())),
            Err(_gone) => Err(self.shared.ended().unwrap_or(ClientError::Closed)),
        }
    }

    /// Counters so far.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        self.shared.counters().statistics.clone()
    }

    /// Latencies of the cameras answered since the last call, oldest first; at most 65,536 are kept.
    #[must_use]
    pub fn take_answers(&self) -> Vec<Answer> {
        self.shared.counters().take_answers()
    }

    /// Why the session is over; `None` while it is not.
    #[must_use]
    pub fn ended(&self) -> Option<ClientError> {
        self.shared.ended()
    }

    /// Sends what waits, says good-bye and waits a moment for the server to end the stream.
    pub async fn close(mut self) {
        self.shared.end(ClientError::Closed);
        if tokio::time::timeout(FAREWELL, &mut self.receiver).await.is_err() {
            tracing::debug!("the server did not end the stream");
        }
    }

    fn check(&self) -> Result<(), ClientError> {
        self.shared.ended().map_or(Ok(()), Err)
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.shared.end(ClientError::Closed);
        self.receiver.abort();
    }
}
