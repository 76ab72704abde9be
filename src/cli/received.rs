//! Plans received on a thread of their own, as an aircraft's are: the first one after an edit comes before the edit is answered.

use std::convert::Infallible;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver};
use std::time::{Duration, Instant};

use overfly_client::{Client, ClientError, Domain, EditOrder, Edited, PlanMessage};

use super::daemon;
use super::failure::Failure;

/// A plan, and when it was received.
pub struct Received {
    pub at: Instant,
    pub plan: PlanMessage,
}

/// How often the thread that receives plans looks whether it is still to do so.
const TURN: Duration = Duration::from_millis(100);

/// Does some work while another thread receives the plans of a scene.
pub fn while_receiving<T>(
    domain: &Domain,
    scene: &str,
    work: impl FnOnce(&Receiver<Received>) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let ((sender, plans), (ready, is_ready)) = (mpsc::channel(), mpsc::channel::<Infallible>());
    let is_over = AtomicBool::new(false);
    let receive = || -> Result<(), ClientError> {
        let client = Client::connect(domain, daemon::REPLAN)?;
        let watch = client.watch(scene)?;
        drop(ready);
        while !is_over.load(Ordering::Relaxed) {
            let plan = watch.next(TURN)?;
            plan.into_iter().for_each(|plan| drop(sender.send(Received { at: Instant::now(), plan })));
        }
        drop(sender);
        Ok(())
    };
    std::thread::scope(|scope| {
        let receiving = scope.spawn(receive);
        let _ = is_ready.recv();
        let done = work(&plans);
        is_over.store(true, Ordering::Relaxed);
        let received = receiving.join().map_err(|_| Failure::Unexpected("the thread that receives plans panicked".to_owned()))?;
        received.map(|()| done)?
    })
}

/// The next plan.
pub fn next(plans: &Receiver<Received>) -> Result<Received, Failure> {
    let received = plans.recv_timeout(daemon::REPLAN);
    received.map_err(|_| Failure::Unexpected("no plan is received any more".to_owned()))
}

/// The first plan in a revision of the scene; those that were published before are passed over.
pub fn first(plans: &Receiver<Received>, revision: u64) -> Result<Received, Failure> {
    loop {
        let received = next(plans)?;
        if received.plan.table().facts.revision == revision {
            return Ok(received);
        }
    }
}

/// An edit that was made.
pub struct Made {
    pub edited: Edited,
    /// When it was sent.
    pub sent: Instant,
    /// From then to the first safe plan.
    pub first: Duration,
}

/// Makes an edit of a scene that has been planned.
pub fn edit(client: &Client, domain: &Domain, scene: &str, order: &EditOrder) -> Result<Made, Failure> {
    while_receiving(domain, scene, |plans| {
        let sent = Instant::now();
        let edited = client.edit(scene, order)?;
        let first = first(plans, edited.revision)?;
        Ok(Made { edited, sent, first: first.at - sent })
    })
}
