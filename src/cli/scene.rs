//! `overfly cancel` and `overfly unload`: what can be done to a loaded scene but to plan and edit it.

use serde_json::json;

use super::answer::Answer;
use super::arguments::SceneArgs;
use super::daemon;
use super::failure::Failure;

/// `overfly cancel`.
pub fn cancel(arguments: &SceneArgs) -> Result<Answer, Failure> {
    let scene = &arguments.scene;
    daemon::connect(arguments.reach.domain.as_deref())?.cancel(scene)?;
    let text = format!("no search of {scene} goes on; whoever asked for it receives the best plan so far");
    Ok(Answer { text, json: json!({ "scene": scene, "cancelled": true }) })
}

/// `overfly unload`.
pub fn unload(arguments: &SceneArgs) -> Result<Answer, Failure> {
    let scene = &arguments.scene;
    daemon::connect(arguments.reach.domain.as_deref())?.unload(scene)?;
    Ok(Answer { text: format!("{scene} is unloaded"), json: json!({ "scene": scene, "unloaded": true }) })
}
