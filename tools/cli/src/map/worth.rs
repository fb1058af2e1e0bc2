//! What a prior is worth for finding poses.

use nvsprior::prior::PoseTrials;
use nvsprior_train::pose_trials::Tried;
use serde_json::{Value, json};

/// If fewer of the searches than this are certain, or poses are further off than this part of the depth of the scene in
/// one of ten cases, a dive gets a warning.
const FOUND: f64 = 0.8;
const FAR: f64 = 0.03;

/// What a rehearsal came to.
pub struct Worth {
    pub tried: Tried,
    /// Of pictures from beside the run.
    pub beside: Tried,
    /// How far away what the run shows is, the prior's unit.
    pub depth: f64,
    pub seconds: f64,
}

impl Worth {
    /// All trials, as a prior holds them.
    pub fn trials(&self) -> PoseTrials {
        PoseTrials::new(self.all().trials).unwrap_or_default()
    }

    pub fn json(&self) -> Value {
        let mut all = summary(&self.all());
        all["on_track"] = summary(&self.tried);
        all["beside"] = summary(&self.beside);
        // How many times further off than an encoder would state by itself.
        all["doubt"] = json!(self.trials().doubt());
        all["depth"] = json!(self.depth);
        all["seconds"] = json!(self.seconds);
        all
    }

    fn all(&self) -> Tried {
        Tried {
            trials: [&self.tried.trials[..], &self.beside.trials].concat(),
            searches: self.tried.searches + self.beside.searches,
        }
    }

    pub fn print(&self) {
        for (place, tried) in [("on the run's track", &self.tried), ("beside it", &self.beside)] {
            say!("poses of a dive {place}: {}", described(tried));
        }
        say!("the rehearsal took {:.0} s", self.seconds);
        let far = self.all().off(0.9).is_none_or(|(most, _)| most > FAR * self.depth);
        if far || self.all().certain() < FOUND {
            tell!(
                "warning: this run does not determine where a camera is; pictures from more sides help: fly arcs \
                 around what is inspected, not towards it alone"
            );
        }
    }
}

fn described(tried: &Tried) -> String {
    let (Some(half), Some(most)) = (tried.off(0.5), tried.off(0.9)) else {
        return "none is found".into();
    };
    format!(
        "off by {:.3} and {:.2}° (half of the cases), {:.3} and {:.2}° (nine of ten); certain in {:.0} %",
        half.0,
        half.1,
        most.0,
        most.1,
        100.0 * tried.certain()
    )
}

fn summary(tried: &Tried) -> Value {
    let (half, most) = (tried.off(0.5).unzip(), tried.off(0.9).unzip());
    json!({
        "position": half.0,
        "position_90": most.0,
        "rotation_degrees": half.1,
        "rotation_90_degrees": most.1,
        "certain": tried.certain(),
        "searches": tried.searches,
    })
}
