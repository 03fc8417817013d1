//! What waits to be sent: the newest of each kind, so that a slow network never makes a queue.

use earthshine_protocol::v1::{self, client_message::Message};
use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
};
use tokio::sync::{Notify, mpsc};

#[derive(Debug, Default)]
struct Waiting {
    lights: Option<v1::Lights>,
    camera: Option<v1::CameraUpdate>,
    /// Newest generation by volume.
    acks: BTreeMap<u32, u64>,
    is_closed: bool,
}

/// Written by the caller's thread and by the receiver, emptied by [`Outbox::pump`].
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    waiting: Mutex<Waiting>,
    wake: Notify,
}

impl Outbox {
    pub(crate) fn set_camera(&self, camera: v1::CameraUpdate) {
        self.change(|waiting| waiting.camera = Some(camera));
    }

    pub(crate) fn set_lights(&self, lights: v1::Lights) {
        self.change(|waiting| waiting.lights = Some(lights));
    }

    pub(crate) fn acknowledge(&self, volume: u32, generation: u64) {
        self.change(|waiting| {
            waiting.acks.insert(volume, generation);
        });
    }

    /// The pump sends what waits, then `Bye`, then ends.
    pub(crate) fn close(&self) {
        self.change(|waiting| waiting.is_closed = true);
    }

    fn change(&self, change: impl FnOnce(&mut Waiting)) {
        change(&mut self.waiting.lock().unwrap_or_else(PoisonError::into_inner));
        self.wake.notify_one();
    }

    fn take(&self) -> Waiting {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let is_closed = waiting.is_closed;
        std::mem::replace(&mut waiting, Waiting { is_closed, ..Waiting::default() })
    }

    /// Sends until the outbox is closed or nobody listens.
    pub(crate) async fn pump(&self, wire: mpsc::Sender<v1::ClientMessage>) {
        loop {
            self.wake.notified().await;
            let Waiting { lights, camera, acks, is_closed } = self.take();
            // Acknowledgements first: the server waits for them with the next delta.
            let acks =
                acks.into_iter().map(|(volume, generation)| Message::Ack(v1::Ack { volume, generation }));
            let bye = is_closed.then_some(Message::Bye(v1::Bye {}));
            let messages =
                acks.chain(lights.map(Message::Lights)).chain(camera.map(Message::Camera)).chain(bye);
            for message in messages {
                if wire.send(v1::ClientMessage { message: Some(message) }).await.is_err() {
                    return;
                }
            }
            if is_closed {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_newest_of_each_kind_is_sent() {
        let outbox = Outbox::default();
        for sequence in 1..=5 {
            outbox.set_camera(v1::CameraUpdate { sequence, ..v1::CameraUpdate::default() });
            outbox.acknowledge(7, sequence);
        }
        outbox.close();
        let (wire, mut sent) = mpsc::channel(8);
        outbox.pump(wire).await;
        let mut messages = Vec::new();
        while let Some(message) = sent.recv().await {
            messages.push(message.message.unwrap());
        }
        assert!(matches!(messages[0], Message::Ack(v1::Ack { volume: 7, generation: 5 })));
        assert!(matches!(messages[1], Message::Camera(v1::CameraUpdate { sequence: 5, .. })));
        assert!(matches!(messages[2], Message::Bye(_)));
        assert_eq!(messages.len(), 3);
    }
}
