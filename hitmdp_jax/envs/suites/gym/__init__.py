"""The Gym MuJoCo tasks, one file each, with Gymnasium's v4 and v5 semantics."""
