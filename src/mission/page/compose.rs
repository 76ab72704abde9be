//! One HTML file of the page's parts.
//!
//! The parts are modules that browsers could load one by one, but a file that is opened from a disk may not load any other. So they are put together: what they
//! import of each other is in one scope then.

/// A program that changes the plan while the page is open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Live {
    /// What the page proves with that it was handed out by this program.
    pub token: String,
}

const INDEX: &str = include_str!("web/index.html");
const DATA_BEGIN: &str = "<script id=\"data\" type=\"application/json\">";
const STYLE: &str = include_str!("web/style.css");
const THREE: &str = include_str!("web/vendor/three.min.js");
const THREE_LICENCE: &str = include_str!("web/vendor/three.LICENSE");

/// In the order in which they use each other.
const MODULES: &[&str] = &[
    include_str!("web/model.js"),
    include_str!("web/theme.js"),
    include_str!("web/structures.js"),
    include_str!("web/surroundings.js"),
    include_str!("web/route.js"),
    include_str!("web/frusta.js"),
    include_str!("web/discs.js"),
    include_str!("web/stage.js"),
    include_str!("web/pointer.js"),
    include_str!("web/charts.js"),
    include_str!("web/timeline.js"),
    include_str!("web/panel.js"),
    include_str!("web/compare.js"),
    include_str!("web/layers.js"),
    include_str!("web/keys.js"),
    include_str!("web/main.js"),
];
const LIVE: &str = include_str!("web/live.js");

/// The page that shows `data`, as [`super::data`] has written it. With `live` it listens to the program that serves it and can change the scene.
pub fn html(data: &[u8], live: Option<&Live>) -> Vec<u8> {
    let settings = live.map(|live| serde_json::json!({ "token": live.token }).to_string().replace('<', "\\u003c"));
    let connect = if live.is_some() { "'self'" } else { "'none'" };
    let modules = MODULES.iter().copied().chain(live.map(|_| LIVE));
    let script: String = modules.map(joined).collect();
    let mut page = Vec::with_capacity(data.len() + THREE.len() + script.len() + 100_000);
    let mut rest = INDEX;
    while let Some((before, marked)) = rest.split_once("{{") {
        let Some((mark, after)) = marked.split_once("}}") else { break };
        page.extend(before.as_bytes());
        match mark {
            "connect" => page.extend(connect.as_bytes()),
            "style" => page.extend(STYLE.as_bytes()),
            "three" => {
                page.extend(format!("/* three.js\n{THREE_LICENCE}*/\n").as_bytes());
                page.extend(THREE.as_bytes());
            }
            "data" => page.extend(data),
            "live" => page.extend(settings.as_deref().unwrap_or("null").as_bytes()),
            "script" => page.extend(script.as_bytes()),
            other => unreachable!("the page has no part called {other:?}"),
        }
        rest = after;
    }
    page.extend(rest.as_bytes());
    page
}

/// The data of a page that [`html`] has made.
pub fn data_of(page: &[u8]) -> Option<&[u8]> {
    let begins = page.windows(DATA_BEGIN.len()).position(|bytes| bytes == DATA_BEGIN.as_bytes())?;
    let rest = &page[begins + DATA_BEGIN.len()..];
    // Data have no such character.
    rest.iter().position(|byte| *byte == b'<').map(|end| &rest[..end])
}

/// A module without what it imports and exports.
fn joined(module: &str) -> String {
    let lines = module.lines().filter(|line| !line.starts_with("import "));
    let lines = lines.map(|line| line.strip_prefix("export ").unwrap_or(line));
    lines.map(|line| format!("{line}\n")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_left_of_imports_and_exports() {
        for module in MODULES.iter().chain([&LIVE]) {
            let script = joined(module);
            let starts = |word: &str| script.lines().any(|line| line.starts_with(word));
            assert!(!starts("import") && !starts("export") && !starts("}} from"), "{}", &module[..60.min(module.len())]);
            assert!(!script.contains("</script") && !script.contains("<!--"));
        }
    }

    #[test]
    fn a_page_is_whole_and_loads_nothing() {
        let page = String::from_utf8(html(b"{\"format\":\"overfly-page/1\"}", None)).unwrap();
        assert!(!page.contains("{{") || THREE.contains("{{"), "all parts are put in");
        assert_eq!(data_of(page.as_bytes()), Some(&b"{\"format\":\"overfly-page/1\"}"[..]));
        assert!(page.contains("connect-src 'none'") && page.contains("The MIT License"));
        for loading in ["src=\"", "<link rel=\"stylesheet", "@import", "url(http"] {
            assert!(!page.contains(loading), "{loading}");
        }
    }

    #[test]
    fn only_a_live_page_may_ask_for_anything() {
        let live = Live { token: "a</script><b".to_owned() };
        let page = String::from_utf8(html(b"{}", Some(&live))).unwrap();
        assert!(page.contains("connect-src 'self'") && page.contains("a\\u003c/script>\\u003cb"));
        assert!(page.ends_with("</html>\n"));
    }
}
