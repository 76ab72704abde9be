//! From the daemon to the board: each plan with its scene, and what goes on meanwhile. When the daemon is lost it is looked for until it is back.

use std::sync::Arc;
use std::time::{Duration, Instant};

use overfly_client::{
    Client, ClientError, Domain, FieldMap, PlanMessage, PlanWatch, RefusalCode, SceneState, SceneStatus, Status, StatusFeed,
};

use overfly_table::plan::SAFE;

use super::board::{Board, Phase};
use super::scenes::{Detail, Stage};

/// How long a daemon that answers may take to do so.
const CONNECT: Duration = Duration::from_millis(300);
/// How often a daemon, or a scene, is looked for.
const LOOK_AGAIN: Duration = Duration::from_millis(250);
/// Without a plan it is looked so often what else is new.
const NEWS: Duration = Duration::from_millis(100);
/// When so long no other plan has come, it is worked out what the last one captures.
const QUIET: Duration = Duration::from_millis(300);

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
    let mut follower =
        Follower { client: &client, scene, board, stage: Stage::default(), instance: None, owed: None, unshown: None };
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
    /// The daemon that this client found.
    instance: Option<u64>,
    /// A plan of which only the path is shown so far, and since when.
    owed: Option<(PlanMessage, Instant)>,
    /// Why the last plan is not shown.
    unshown: Option<String>,
}

impl Follower<'_> {
    fn step(&mut self, watch: &PlanWatch, feed: &StatusFeed) -> Result<(), Parting> {
        let (mut plan, mut newest) = (watch.next(NEWS)?, None);
        while let Some(status) = feed.next(Duration::ZERO)? {
            newest = Some(status);
        }
        // What was published before that status is shown before it.
        while let Some(message) = plan {
            self.show_plan(message)?;
            plan = watch.next(Duration::ZERO)?;
        }
        newest.map_or(Ok(()), |status| self.take(&status))?;
        if let Some((message, _)) = self.owed.take_if(|(_, since)| since.elapsed() >= QUIET) {
            self.show(&self.client.field(self.scene)?, &message, Detail::Everything);
        }
        Ok(())
    }

    /// After an edit paths go out alone, for as long as one follows the other; what the last of them captures takes a page and this machine longer.
    fn show_plan(&mut self, message: PlanMessage) -> Result<(), Parting> {
        // It comes before the field that pages show its scene from, and the plan that comes with that has the same path.
        if message.table().facts.stop == SAFE {
            return Ok(());
        }
        let map = self.client.field(self.scene)?;
        let is_alone = self.owed.is_some() || self.stage.field() != Some((map.instance(), map.epoch()));
        let is_shown = self.show(&map, &message, if is_alone { Detail::Path } else { Detail::Everything });
        if is_alone && is_shown {
            self.owed = Some((message, Instant::now()));
        }
        Ok(())
    }

    /// Whether the plan is one of the scene as it is. One of an earlier scene is not to be flown any more, and the next one is on its way.
    fn show(&mut self, map: &FieldMap, message: &PlanMessage, detail: Detail) -> bool {
        let field = map.table();
        if field.facts.revision != message.table().facts.revision {
            return false;
        }
        let shown = self.stage.plan((map.instance(), map.epoch()), &field, message, detail);
        self.unshown = shown.as_ref().err().map(|error| format!("a plan cannot be shown: {error}"));
        if let Ok(state) = shown {
            self.board.show(&state);
        }
        true
    }

    /// The scene alone, where there is no plan of it.
    fn show_scene(&mut self) -> Result<(), Parting> {
        let map = self.client.field(self.scene)?;
        let number = (map.instance(), map.epoch());
        if self.stage.field() != Some(number) {
            let state = self.stage.scene(number, &map.table(), self.scene);
            self.board.show(&state);
        }
        Ok(())
    }

    fn take(&mut self, status: &Status) -> Result<(), Parting> {
        if *self.instance.get_or_insert(status.instance) != status.instance {
            return Err(Parting::Lost("the daemon was started anew".into()));
        }
        let scene = status.scenes.iter().find(|scene| scene.name == self.scene);
        let scene = scene.ok_or_else(|| Parting::Unloaded(format!("the scene {:?} is not loaded", self.scene)))?;
        // A plan that was not made again after an edit is none of the scene as it is now.
        if scene.state == SceneState::Idle && scene.plan.as_ref().is_none_or(|plan| plan.is_stale) {
            self.show_scene()?;
        }
        let instance = status.instance;
        self.board.tell(|status| {
            status.hear(instance, scene.revision);
            status.phase = phase(scene);
            status.remark = self.unshown.clone().or_else(|| scene.remark.clone());
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
            ClientError::Refused { code: RefusalCode::UnknownScene | RefusalCode::Busy, message } => Self::Unloaded(message),
            other => Self::Lost(other.to_string()),
        }
    }
}
