//! The optimization tool's side: discovery, dispatch of episodes, results.
