//! From the daemon to the board: each plan with its scene, and what goes on meanwhile. When the daemon is lost it is looked for until it is back.

use std::sync::Arc;
use std::time::Duration;

use overfly_client::{
    Client, ClientError, Domain, PlanMessage, PlanWatch, RefusalCode, SceneState, SceneStatus, Status, StatusFeed,
};

use super::board::{Board, Phase};
use super::scenes::{Detail, Stage};

/// How long a daemon that answers may take to do so.
const CONNECT: Duration = Duration::from_millis(300);
/// How often a daemon, or a scene, is looked for.
const LOOK_AGAIN: Duration = Duration::from_millis(250);
/// Without a plan it is looked so often what else is new.
const NEWS: Duration = Duration::from_millis(100);

/// Why the daemon is not followed any more.
enum Parting {
    Lost(String),
    Unloaded(String),
}

/// Follows a scene on a thread of its own until the program ends.
pub fn start(domain: Domain, scene: String, board: Arc<Board>) -> std::io::Result<()> {
    let follow = move || {
        loop {
            let Err(parting) = attend(&domain, &scene, &board);
            let (phase, remark) = match parting {
                // Whatever it was that failed, a page is to say what it means.
                Parting::Lost(cause) => (Phase::Lost, format!("the contact to the daemon is lost: {cause}")),
                Parting::Unloaded(remark) => (Phase::Unloaded, remark),
            };
            board.tell(|status| (status.phase, status.remark) = (phase, Some(remark)));
            std::thread::sleep(LOOK_AGAIN);
        }
    };
    std::thread::Builder::new().name("plans".into()).spawn(follow).map(drop)
}

fn attend(domain: &Domain, scene: &str, board: &Board) -> Result<std::convert::Infallible, Parting> {
    let client = Client::connect(domain, CONNECT)?;
    let watch = client.watch(scene)?;
    let feed = client.status_feed()?;
    let mut follower = Follower { client: &client, scene, board, stage: Stage::default(), instance: None };
    // The plan that was published before anybody looked.
    match client.publish_again(scene) {
        Ok(_) => {}
        Err(ClientError::Refused { code: RefusalCode::UnknownScene, .. }) => follower.show_scene()?,
        Err(error) => return Err(error.into()),
    }
    loop {
        follower.step(&watch, &feed)?;
    }
}

struct Follower<'a> {
    client: &'a Client,
    scene: &'a str,
    board: &'a Board,
    stage: Stage,
    instance: Option<u64>,
}

impl Follower<'_> {
    fn step(&mut self, watch: &PlanWatch, feed: &StatusFeed) -> Result<(), Parting> {
        if let Some(message) = watch.next(NEWS)? {
            self.show_plan(message)?;
        }
        while let Some(status) = feed.next(Duration::ZERO)? {
            self.take(&status)?;
        }
        Ok(())
    }

    fn show_plan(&mut self, message: PlanMessage) -> Result<(), Parting> {
        let map = self.client.field(self.scene)?;
        let field = map.table();
        // A plan of an earlier scene is not to be flown any more, and the next one is on its way.
        if field.facts.revision != message.table().facts.revision {
            return Ok(());
        }
        // After an edit the path goes out first.
        let is_next = self.stage.revision() != Some(field.facts.revision);
        let details = [Detail::Path, Detail::Everything];
        for detail in details.into_iter().skip(usize::from(!is_next)) {
            match self.stage.plan((map.instance(), map.epoch()), &field, &message, detail) {
                Ok(state) => self.board.show(&state),
                Err(error) => self.board.tell(|status| status.remark = Some(format!("a plan cannot be shown: {error}"))),
            }
        }
        Ok(())
    }

    /// The scene alone, where there is no plan of it.
    fn show_scene(&mut self) -> Result<(), Parting> {
        let map = self.client.field(self.scene)?;
        let state = self.stage.scene((map.instance(), map.epoch()), &map.table(), self.scene);
        self.board.show(&state);
        Ok(())
    }

    fn take(&mut self, status: &Status) -> Result<(), Parting> {
        if *self.instance.get_or_insert(status.instance) != status.instance {
            return Err(Parting::Lost("the daemon was started anew".into()));
        }
        let scene = status.scenes.iter().find(|scene| scene.name == self.scene);
        let scene = scene.ok_or_else(|| Parting::Unloaded(format!("the scene {:?} is not loaded", self.scene)))?;
        if scene.plan.is_none() && scene.state == SceneState::Idle && self.stage.revision() != Some(scene.revision) {
            self.show_scene()?;
        }
        self.board.tell(|status| {
            status.phase = phase(scene);
            status.revision = Some(scene.revision);
            status.remark = scene.remark.clone();
        });
        Ok(())
    }
}

fn phase(scene: &SceneStatus) -> Phase {
    match scene.state {
        SceneState::Idle => Phase::Idle,
        SceneState::Building => Phase::Building,
        SceneState::Planning => Phase::Planning,
    }
}

impl From<ClientError> for Parting {
    fn from(error: ClientError) -> Self {
        match error {
            ClientError::Refused { code: RefusalCode::UnknownScene, message } => Self::Unloaded(message),
            other => Self::Lost(other.to_string()),
        }
    }
}
