"""Whatever a new user gets wrong is said in one sentence, and nothing is trained or overwritten.

Every row is one mistake and a part of the sentence that explains it. Command lines run in this
process, in a folder whose files must all be as before; a row that would train fails.
"""

import functools
import os
import shutil
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml

import hitmdp_jax
from hitmdp_jax.agents import AHP, DAC, IOPG, MOPG, OC, PPO, PPOC
from hitmdp_jax.analysis.evaluation import score
from hitmdp_jax.commands import arms, evaluate, export, reproduce, train, video
from hitmdp_jax.envs.toy.turkey import Turkey
from hitmdp_jax.errors import UsageError
from hitmdp_jax.training import loop
from hitmdp_jax.training.checkpoint import Checkpoints, Progress
from hitmdp_jax.training.config import RunConfig
from tests.probes import Target

TRAIN = [
    # Names
    ("env=halfchetah", "Unknown environment 'halfchetah'; did you mean 'halfcheetah'?"),
    ("env=HalfCheetah", "did you mean 'halfcheetah'?"),
    ("env=HalfCheetah-v5", "did you mean 'halfcheetah'?"),
    ("env=own", "Unknown environment 'own'"),
    ("env=", "Unknown environment ''"),
    ("env=null", "Unknown environment"),
    ("env=dmc/cheetah_rum", "did you mean 'dmc/cheetah_run'?"),
    ("env=brax/antt", "did you mean 'brax/ant'?"),
    ("env=cheetah_run", "did you mean 'dmc/cheetah_run'?"),
    ("env=../config", "Unknown environment '../config'"),
    ("envs=halfcheetah", "Unknown setting 'envs'"),
    ("algo=mopgg", "Unknown algo 'mopgg'; did you mean 'mopg'?"),
    ("algo=", "Unknown algo ''"),
    ("algo=sac", "Unknown algo 'sac'"),
    ("algo.name=sac", "Unknown algo 'sac'"),
    ("algo.learningrate=1e-3", "did you mean 'algo.learning_rate'?"),
    ("+algo.colour=red", "colour"),
    ("+colour=red", "colour"),
    ("learning_rate=1e-3", "did you mean 'algo.learning_rate'?"),
    ("env.ctrl_cost=0.1", "did you mean 'env.ctrl_cost_weight'?"),
    ("env.name=halfchetah", "did you mean 'halfcheetah'?"),
    ("env.version=v3", "Unknown version 'v3'"),
    ("experiment=transfr", "did you mean 'transfer'?"),
    ("pair=chetah", "did you mean 'cheetah'?"),
    ("preset=papr", "did you mean 'paper'?"),
    ("tuned=nothing", "Unknown tuned 'nothing'"),
    ("preset=paper algo=ppo", "master_policy"),
    ("physics=mujoco", "Unknown physics 'mujoco'"),
    ("physics=", "Unknown physics ''"),
    ("physics=null", "Unknown physics 'None'"),
    ("physics=3", "Unknown physics '3'"),
    ("env=brax/ant physics=native", "physics must stay at its default"),
    ("wandb=yes", "Unknown wandb"),
    ("wandb=online", "Unknown wandb 'online'"),
    ("seed.a=1", "Unknown setting 'seed.a'"),
    # The form
    ("halfcheetah", "'halfcheetah' is not of the form name=value"),
    ("=halfcheetah", "'=halfcheetah' is not of the form name=value"),
    ("seeds 4", "'seeds' is not of the form name=value"),
    ("algo.hidden_sizes=[64", "is not of the form name=value"),
    ("seed=0,1", "add -m"),
    ("~algo", "algo"),
    ("~physics", "physics"),
    ("~total_steps", "total_steps"),
    ("seeds=${nothing}", "nothing"),
    ("seeds=???", "seeds"),
    ("--colour", "--colour"),
    ("--epochs=3", "--epochs"),
    ("--cfg", "--cfg"),
    # Whole numbers
    ("seeds=0", "seeds = 0 must be a positive whole number"),
    ("seeds=-1", "seeds = -1 must be a positive whole number"),
    ("seeds=two", "seeds = two must be a positive whole number"),
    ("seeds=1.5", "seeds = 1.5 must be a positive whole number"),
    ("seeds=true", "seeds = True must be a positive whole number"),
    ("seeds=null", "seeds = None must be a positive whole number"),
    ("seeds=", "seeds"),
    ("seeds=[1,2]", "seeds = [1, 2] must be a positive whole number"),
    ("seeds={a:1}", "seeds"),
    ("seed=-1", "seed = -1 must be a whole number from 0"),
    ("seed=4294967296", "seed = 4294967296 must be a whole number below 2^32 - seeds"),
    ("seed=12345678901234567890", "seed"),
    ("seed=abc", "seed = abc must be a whole number"),
    ("total_steps=0", "total_steps = 0 must be a positive whole number"),
    ("total_steps=-5", "total_steps = -5 must be a positive whole number"),
    ("total_steps=1e20", "at most 1e+12"),
    ("total_steps=nan", "total_steps = nan must be a positive whole number"),
    ("total_steps=inf", "total_steps = inf must be a positive whole number"),
    ("total_steps=1e", "total_steps = 1e must be a positive whole number"),
    ("total_steps=1M", "total_steps = 1M must be a positive whole number"),
    ("num_envs=0", "num_envs = 0 must be a positive whole number"),
    ("num_envs=many", "num_envs = many must be a positive whole number"),
    ("data_devices=0", "data_devices = 0 must be a positive whole number"),
    ("data_devices=two", "data_devices = two must be a positive whole number"),
    ("data_devices=3", "num_envs = 16 is not divisible by data_devices = 3; the nearest"),
    ("num_envs=7 rollout_length=11", "is not divisible by minibatch_size"),
    ("rollout_length=-128", "rollout_length = -128 must be a positive whole number"),
    ("checkpoint_steps=0", "checkpoint_steps = 0 must be a positive whole number"),
    ("eval_every=-1", "eval_every = -1 must be a whole number from 0"),
    ("eval_episodes=0", "eval_episodes = 0 must be a positive whole number"),
    ("video_every=-1", "video_every = -1 must be a whole number from 0"),
    ("video_every=5 env=toy/turkey", "toy/turkey cannot be filmed: it has no MuJoCo model."),
    ("video_every=5 env=brax/ant", "brax/ant cannot be filmed: it has no MuJoCo model."),
    # Hyperparameters
    ("algo.learning_rate=fast", "algo.learning_rate = fast must be a number"),
    ("algo.learning_rate=inf", "learning_rate = inf must be a finite number from 0"),
    ("algo.learning_rate=nan", "learning_rate = nan must be a finite number from 0"),
    ("algo.learning_rate=-1", "learning_rate = -1.0 must be a finite number from 0"),
    ("algo.learning_rate=null", "algo.learning_rate = None must be a number"),
    ("algo.learning_rate=true", "algo.learning_rate = True must be a number"),
    ("algo.learning_rate=[1,2]", "algo.learning_rate = [1, 2] must be a number"),
    ("algo.learning_rate={a:1}", "algo.learning_rate"),
    ("algo.gamma=1.1", "gamma = 1.1 must be a number from 0 to 1"),
    ("algo.gae_lambda=-0.1", "gae_lambda = -0.1 must be a number from 0 to 1"),
    ("algo.num_options=0", "num_options = 0 must be a positive whole number"),
    ("algo.num_options=1e30", "num_options"),
    ("algo.num_epochs=2.5", "num_epochs = 2.5 must be a positive whole number"),
    ("algo.minibatch_size=100", "not divisible by minibatch_size = 100"),
    ("algo.hidden_sizes=64", "hidden_sizes = 64 must be a list of positive whole numbers"),
    ("algo.hidden_sizes=[]", "hidden_sizes = [] must be a list of positive whole numbers"),
    ("algo.hidden_sizes=[64,a]", "must be a list of positive whole numbers"),
    ("algo.hidden_sizes=[[64]]", "must be a list of positive whole numbers"),
    ("algo.activation=gelu", "Unknown activation 'gelu'"),
    ("algo.activation=[relu]", "Unknown activation"),
    ("algo.master_policy=simple", "Unknown master_policy 'simple'"),
    ("algo.mutual_information=all", "Unknown mutual_information 'all'"),
    ("algo.bootstrap_on_truncation=maybe", "must be true or false"),
    ("algo.similarity=", "algo.similarity =  must be a number"),
    ("algo=[ppo]", "Unknown algo"),
    # A task's keywords
    ("env.ctrl_cost_weight=abc", "ctrl_cost_weight = abc must be a finite number"),
    ("env.reset_noise_scale=-3", "reset_noise_scale = -3 must be a finite number from 0"),
    ("env=hopper env.healthy_z_range=[2,1]", "two numbers, the lower first"),
    ("env=brax/ant env.backend=cuda", "cuda"),
    ("env=brax/ant +env.backend=cuda", "Could not append"),
    # Folders
    ("run_dir=", "run_dir = '' names no folder"),
    ("run_dir=[a]", "run_dir = ['a'] names no folder"),
    ("run_dir=true", "run_dir = True names no folder"),
    ("run_dir=run", "'run' holds a run already"),
    ("run_dir=run overwrite=maybe", "overwrite"),
    ("run_dir=run overwrite=1", "overwrite"),
    ("run_dir=run overwrite=true seeds=0", "seeds = 0 must be a positive whole number"),
    ("run_dir=run overwrite=true env=brax/ant physics=native", "must stay at its default"),
    ("run_dir=notes.txt", "run_dir = notes.txt is not a folder"),
    ("run_dir=notes.txt/run", "run_dir = notes.txt/run cannot be written"),
    ("run_dir=/proc/run", "run_dir = /proc/run cannot be written"),
    (f"run_dir={'x' * 300}", "cannot be written"),
    ("overwrite=no_way", "overwrite"),
    # Resuming
    ("resume=", "resume = '' names no folder"),
    ("resume=nowhere", "'nowhere' is not a run's folder"),
    ("resume=empty", "'empty' is not a run's folder"),
    ("resume=notes.txt", "'notes.txt' is not a run's folder"),
    ("distributed=2", "distributed = 2 must be true or false"),
    ("-m distributed=true seed=0,1", "leave -m out"),
    ("resume=latest", "resume=latest finds no run"),
    ("resume=run env=ant", "data_devices can be changed, not 'env'"),
    ("resume=run algo.gamma=0.9", "data_devices can be changed, not 'algo.gamma'"),
    ("resume=run run_dir=other", "data_devices can be changed, not 'run_dir'"),
    ("resume=run total_steps=1", "is less than the 4,096 that 'run' has done"),
    ("resume=run total_steps=abc", "total_steps = abc must be a positive whole number"),
    ("resume=run total_stepz=1", "Unknown setting 'total_stepz'"),
    ("resume=from_python", "was saved from Python"),
    ("resume=torn", "No checkpoint in"),
    ("resume=garbage", "No checkpoint in"),
    ("resume=misfit", "does not fit its config.yaml"),
    # Own files
    ("env=missing.py:Task", "names no file"),
    ("env=own.py:Missing", "Unknown class of"),
    ("env=own.py:", "Unknown class of"),
    ("env=own.py", "Unknown environment 'own.py'"),
    ("env=own.py:value", "Unknown class of"),
    ("env=own.py:function", "Unknown class of"),
    ("env=own.py:Plain", "makes no environment"),
    ("env=own.py:Task env.colour=red", "Unknown keyword of own.Task 'colour'"),
    ("env=own.py:Task env.size=big", "size = big must be a whole number"),
    ("env=empty:Task", "Unknown environment 'empty:Task'"),
    ("algo=missing.py:Algo", "names no file"),
    ("algo=own.py:Plain", "is no algorithm"),
    ("algo=own.py:Abstract", "is abstract: it still needs act, init, update"),
    ("env=own.py:AbstractTask", "is abstract: it still needs"),
    ("+env.physics=native", "Unknown setting 'env.physics'"),
    ("algo=own.py:Algo algo.colour=red", "Unknown hyperparameter of own.Algo 'colour'"),
    # Sweeps as an axis
    ("sweep=1", "sweep = 1 must name what is swept"),
    ("sweep={}", "sweep = {} must name what is swept"),
    ("sweep=[1e-4,3e-4]", "must name what is swept"),
    ("sweep={algo.learning_rte:[1e-4]}", "did you mean 'algo.learning_rate'?"),
    ("sweep={learning_rate:[1e-4]}", "did you mean 'algo.learning_rate'?"),
    ("sweep={seed:[1,2]}", "Unknown swept hyperparameter 'seed'"),
    ("sweep={algo.num_options:[2,4]}", "algo.num_options shapes the program"),
    ("sweep={algo.learning_rate:1e-4}", "must be a list of numbers or a range"),
    ("sweep={algo.learning_rate:[]}", "must be a list of numbers or a range"),
    ("sweep={algo.learning_rate:[a,b]}", "must be a list of numbers or a range"),
    ("sweep={algo.learning_rate:[1e-4,1e-4]}", "lists a value twice"),
    ("sweep={algo.learning_rate:[1e-4,-1]}", "learning_rate = -1.0 must be a finite number from 0"),
    ("sweep={algo.learning_rate:{uniform:[1e-4,1e-3]}}", "say how often, samples=20"),
    ("sweep={algo.learning_rate:{uniform:[1,0]}} samples=3", "two ascending numbers"),
    ("sweep={algo.learning_rate:{log_uniform:[0,1]}} samples=3", "two ascending numbers above 0"),
    ("sweep={algo.learning_rate:{log_unifrm:[1e-4,1]}} samples=3", "did you mean 'log_uniform'?"),
    ("sweep={algo.gamma:[0.9]} samples=0", "samples = 0 must be a positive whole number"),
    ("sweep={algo.gamma:[0.9]} samples=1e9", "has 1,000,000,000 settings"),
    ("samples=3", "samples = 3 draws from a sweep"),
    ("sweep={algo.gamma:[0.9}", "is not of the form name=value"),
    # Sweeps with -m: no job starts
    ("-m algo.learning_rate=1e-4,abc", "algo.learning_rate = abc must be a number"),
    ("-m env=toy/turkey,halfchetah", "did you mean 'halfcheetah'?"),
    ("-m seed=0,-1", "seed = -1 must be a whole number"),
    ("-m num_envs=16,3 rollout_length=100", "is not divisible by minibatch_size"),
    ("-m run_dir=a,b", "cannot be swept"),
    ("-m seed=0,1 run_dir=", "run_dir = '' names no folder"),
    ("-m seed=0,1 run_dir=notes.txt", "notes.txt"),
    ("-m seed=0,1 env=brax/ant physics=native", "physics must stay at its default"),
    ("-m resume=run,nowhere", "leave -m out"),
    ("-m colour=red,blue", "Unknown setting 'colour'"),
]  # fmt: skip

# What reads a run's folder says what is wrong with it, whichever command it is.
FOLDERS = [
    ("nowhere", "'nowhere' is not a run's folder"),
    ("empty", "'empty' is not a run's folder"),
    ("notes.txt", "'notes.txt' is not a run's folder"),
    ("broken", "cannot be read"),
    ("binary", "cannot be read"),
    ("blank", "cannot be read"),
    ("listed", "cannot be read"),
    ("python_tag", "cannot be read"),
    ("directory", "is not a run's folder"),
    ("newer", "was written by a newer hitmdp_jax"),
    ("schema_word", "newer"),
    ("unknown_algo", "Unknown algo 'sac'"),
    ("unknown_env", "Unknown environment 'halfchetah'"),
    ("unknown_setting", "Unknown setting 'colour'"),
    ("number_key", "Unknown setting '3'"),
    ("no_algo", "algo"),
    ("wrong_type", "seeds = two must be a positive whole number"),
    ("wrong_env", "env = halfcheetah must hold a name and its settings"),
    ("wrong_name", "env"),
    ("wrong_keyword", "colour"),
    ("own_gone", "names no file"),
]

EVALUATE = [
    ("", "run_dir"),
    ("run more", "more"),
    ("run --episodes 0", "episodes = 0 must be a positive whole number"),
    ("run --episodes -3", "episodes = -3 must be a positive whole number"),
    ("run --episodes abc", "--episodes"),
    ("run --episodes 1.5", "--episodes"),
    ("run --episodes", "--episodes"),
    ("run --episodes 100000000000000", "episodes = 100000000000000 must be"),
    ("run --episode-count 5", "--episode-count"),
    ("run --engine gym", "Unknown engine 'gym'"),
    ("run --engine gymnasium", "Gymnasium has no environment"),
    ("run --engine ''", "Unknown engine ''"),
    ("run --seed 9", "seed = 9 is not in the run"),
    ("run --seed -1", "seed = -1 is not in the run"),
    ("run --seed one", "--seed"),
    ("run --setting 1", "setting = 1 is not in the run"),
    ("run --setting one", "--setting"),
    ("run --checkpoint 7", "holds no checkpoint 7"),
    ("run --checkpoint last", "holds no checkpoint last"),
    ("run --checkpoint -1", "holds no checkpoint -1"),
    ("run --checkpoint ²", "holds no checkpoint ²"),
    ("run --json=yes", "--json"),
    ("unsaved", "holds no checkpoint"),
    ("torn", "No checkpoint in"),
    ("garbage", "No checkpoint in"),
    ("stray", "holds no checkpoint"),
    ("misfit", "does not fit the algorithm"),
    ("other_algo", "does not fit the algorithm"),
    ("other_seeds", "does not fit the algorithm and seeds"),
    ("other_env", "its last axis must be 2 long"),
    ("from_python", "names no task"),
    *FOLDERS,
]

VIDEO = [
    ("run", "toy/turkey cannot be filmed: it has no MuJoCo model."),
    ("run --episodes 0", "episodes = 0 must be a positive whole number"),
    ("run --engine gym", "Unknown physics 'gym'"),
    ("run --engine ''", "Unknown physics ''"),
    ("from_python", "names no task"),
    *FOLDERS,
]

EXPORT = [
    ("run --format onx", "Unknown format 'onx'; did you mean 'onnx'?"),
    ("run --out run", "'run' cannot be used: Is a directory."),
    ("run more", "more"),
    ("run --seed 9", "seed = 9 is not in the run"),
    ("run --setting 1", "setting = 1 is not in the run"),
    ("run --checkpoint 7", "holds no checkpoint 7"),
    ("misfit", "does not fit the algorithm"),
    ("other_env", "its last axis must be 2 long"),
    *FOLDERS,
]

REPRODUCE = [
    ("comparison", "Unknown target 'comparison'; did you mean 'compare'?"),
    ("env=halfcheetah", "Unknown target 'env=halfcheetah'"),
    ("--targets", "Unknown target '--targets'"),
    ("compare halfcheetah", "'halfcheetah' is not of the form name=value"),
    ("compare algos=mopg,pppo", "Unknown algo 'pppo'; did you mean 'ppo'?"),
    ("compare algos=", "Unknown algo ''"),
    ("compare algos=mopg,", "Unknown algo ''"),
    ("compare algos=mopg,mopg", "mopg"),
    ("compare algos=own.py:Plain", "is no algorithm"),
    ("compare algo=ppo", "algos="),
    ("compare alogs=ppo", "Unknown setting 'alogs'"),
    ("compare resume=run", "resume"),
    ("compare sweep={algo.gamma:[0.9]}", "compare takes no sweep="),
    ("compare env=halfchetah", "did you mean 'halfcheetah'?"),
    ("compare seeds=0", "seeds = 0 must be a positive whole number"),
    ("compare seed=0,1", "lists several values"),
    ("compare -m seed=0,1", "-m"),
    ("compare experiment=transfer pair=chetah", "did you mean 'cheetah'?"),
    ("compare env=brax/ant physics=native", "physics must stay at its default"),
    ("compare run_dir=", "run_dir = '' names no folder"),
    ("compare run_dir=notes.txt algos=ppo", "notes.txt"),
    ("compare run_dir=compared env=toy/turkey algos=ppo seeds=5", "a run with other settings"),
    ("theory sed=1", "Unknown setting 'sed'; did you mean 'seed'?"),
    ("theory seed=-1", "seed = -1 must be a whole number"),
    ("theory seed=abc", "seed = abc must be a whole number"),
    ("theory seed=", "seed =  must be a whole number"),
    ("theory seed=4294967296", "seed = 4294967296 must be a whole number"),
    ("theory seed", "'seed' is not of the form name=value"),
    ("theory seed=²", "seed = ² must be a whole number"),
    ("theory run_dir=", "run_dir = '' names no folder"),
    ("theory run_dir=notes.txt", "notes.txt"),
    ("theory run_dir=notes.txt/a", "notes.txt/a"),
]  # fmt: skip

SIZES = {"num_steps": 128, "num_envs": 8, "rollout_length": 16}
make_train = functools.partial(hitmdp_jax.make_train, **SIZES)


class Several(Target):
    observation_size = {"a": 1, "b": 2}  # noqa: RUF012


PYTHON = {
    "make_env(None)": (lambda: hitmdp_jax.make_env(None), "env = None must be the name"),
    "make_env(3)": (lambda: hitmdp_jax.make_env(3), "env = 3 must be the name"),
    "make_env([])": (lambda: hitmdp_jax.make_env([]), "env = [] must be the name"),
    "make_env('')": (lambda: hitmdp_jax.make_env(""), "Unknown environment ''"),
    "make_env('brax/')": (lambda: hitmdp_jax.make_env("brax/"), "Unknown environment 'brax/'"),
    "env misspelt": (lambda: hitmdp_jax.make_env("hoper"), "did you mean 'hopper'?"),
    "keyword misspelt": (
        lambda: hitmdp_jax.make_env("hopper", ctrl_weight=1),
        "Unknown keyword of hopper 'ctrl_weight'",
    ),
    "keyword of wrong type": (
        lambda: hitmdp_jax.make_env("hopper", ctrl_cost_weight="a"),
        "ctrl_cost_weight = a must be a finite number",
    ),
    "keyword NaN": (
        lambda: hitmdp_jax.make_env("hopper", ctrl_cost_weight=np.float32("nan")),
        "ctrl_cost_weight = nan must be a finite number",
    ),
    "keyword array": (
        lambda: hitmdp_jax.make_env("hopper", ctrl_cost_weight=np.ones(3)),
        "must be a finite number",
    ),
    "version None": (lambda: hitmdp_jax.make_env("hopper", version=None), "Unknown version 'None'"),
    "version 5": (lambda: hitmdp_jax.make_env("hopper", version=5), "Unknown version '5'"),
    "version []": (lambda: hitmdp_jax.make_env("hopper", version=[]), "Unknown version '[]'"),
    "physics None": (lambda: hitmdp_jax.make_env("hopper", physics=None), "Unknown physics 'None'"),
    "physics misspelt": (lambda: hitmdp_jax.make_env("hopper", physics="natve"), "'native'?"),
    "register built-in": (lambda: hitmdp_jax.register_env("hopper", Turkey), "built-in"),
    "register brax": (lambda: hitmdp_jax.register_env("brax/ant", Turkey), "built-in"),
    "register nothing": (lambda: hitmdp_jax.register_env("mine", None), "constructor = None"),
    "register object": (lambda: hitmdp_jax.register_env("mine", Target()), "constructor"),
    "register None": (lambda: hitmdp_jax.register_env(None, Turkey), "name = None"),
    "register ''": (lambda: hitmdp_jax.register_env("", Turkey), "name = ''"),
    "agent class": (lambda: make_train(PPO, Target()), "pass an agent, PPO()"),
    "agent name": (lambda: make_train("ppo", Target()), "'ppo' is not an agent"),
    "agent None": (lambda: make_train(None, Target()), "None is not an agent"),
    "env name": (lambda: make_train(PPO(), "hopper"), "make_env('hopper')"),
    "env class": (lambda: make_train(PPO(), Turkey), "Turkey"),
    "env None": (lambda: make_train(PPO(), None), "None"),
    "env of several arrays": (lambda: make_train(PPO(), Several()), "several arrays"),
    "batch that does not divide": (
        lambda: hitmdp_jax.make_train(PPO(minibatch_size=100), Target(), **SIZES),
        "not divisible by minibatch_size = 100",
    ),
    "train without steps": (
        lambda: hitmdp_jax.train(PPO(), Target(), jax.random.key(0), num_steps=0),
        "num_steps = 0 must be a positive whole number",
    ),
    "train of a class": (
        lambda: hitmdp_jax.train(PPO, Target(), jax.random.key(0), num_steps=1),
        "pass an agent",
    ),
    "train of a number": (
        lambda: hitmdp_jax.train(PPO(), Target(), 0, **SIZES),
        "key = 0 must be a key",
    ),
    **{
        f"{name}={value!r}": (
            lambda name=name, value=value: hitmdp_jax.make_train(
                PPO(), Target(), **(SIZES | {name: value})
            ),
            f"{name} = {value} must be a positive whole number",
        )
        for name, value in [
            ("num_steps", "a"),
            ("num_steps", 0),
            ("num_steps", True),
            ("num_steps", 2.5),
            ("num_steps", None),
            ("num_envs", -8),
            ("num_envs", "8"),
            ("rollout_length", np.inf),
            ("rollout_length", [16]),
            ("episode_length", 0),
            ("episode_length", -1),
            ("episode_length", "long"),
            ("reset_pool_size", 0),
            ("reset_pool_size", 1.5),
        ]
    },
    **{
        f"{agent.__name__}({name}={getattr(value, '__name__', repr(value))})": (
            lambda agent=agent, name=name, value=value: agent(**{name: value}),
            part,
        )
        for agent, name, value, part in [
            (PPO, "learning_rate", "fast", "learning_rate = fast must be a finite number from 0"),
            (PPO, "learning_rate", np.nan, "learning_rate = nan must be a finite number from 0"),
            (PPO, "learning_rate", -1.0, "learning_rate = -1.0 must be a finite number from 0"),
            (PPO, "learning_rate", None, "learning_rate = None must be a finite number from 0"),
            (PPO, "learning_rate", [1e-3], "learning_rate = [0.001] must be a finite number"),
            (PPO, "gamma", 2, "gamma = 2 must be a number from 0 to 1"),
            (PPO, "hidden_sizes", 64, "hidden_sizes = 64 must be a list"),
            (PPO, "hidden_sizes", (), "hidden_sizes = [] must be a list"),
            (PPO, "hidden_sizes", (0,), "hidden_sizes = [0] must be a list"),
            (PPO, "hidden_sizes", ("a",), "hidden_sizes = ['a'] must be a list"),
            (PPO, "hidden_sizes", np.array([64, 64]), "must be a list"),
            (PPO, "activation", "gelu", "Unknown activation 'gelu'"),
            (PPO, "activation", None, "Unknown activation 'None'"),
            (PPO, "activation", jnp.tanh, "Unknown activation"),
            (PPO, "num_epochs", 0, "num_epochs = 0 must be a positive whole number"),
            (PPO, "num_epochs", 1.5, "num_epochs = 1.5 must be a positive whole number"),
            (PPO, "bootstrap_on_truncation", 1, "must be true or false"),
            (MOPG, "num_options", True, "num_options = True must be a positive whole number"),
            (MOPG, "initial_log_std", 11.0, "must be a number from -10 to 10"),
            (MOPG, "entropy_schedule", "cubic", "Unknown entropy_schedule 'cubic'"),
            (DAC, "num_options", "4", "num_options = 4 must be a positive whole number"),
            (AHP, "num_options", -1, "num_options = -1 must be a positive whole number"),
            (PPOC, "clip_eps", "wide", "clip_eps = wide must be a number"),
            (IOPG, "num_options", 0, "num_options = 0 must be a positive whole number"),
            (OC, "num_options", 2.0, "num_options = 2.0 must be a positive whole number"),
            (OC, "colour", "red", "Unknown hyperparameter of OC 'colour'"),
            (PPO, "learningrate", 1e-3, "did you mean 'learning_rate'?"),
        ]
    },
    "replace by a bad value": (lambda: PPO().replace(gamma=np.inf), "gamma = inf must be a number"),
    "replace of nothing": (lambda: PPO().replace(gama=0.9), "did you mean 'gamma'?"),
    "load nowhere": (lambda: hitmdp_jax.load("nowhere"), "'nowhere' is not a run's folder"),
    "load ''": (lambda: hitmdp_jax.load(""), "run_dir = ''"),
    "load None": (lambda: hitmdp_jax.load(None), "run_dir = None"),
    "load seed": (lambda: hitmdp_jax.load("run", seed=99), "seed = 99 is not in the run"),
    "load seed word": (lambda: hitmdp_jax.load("run", seed="a"), "seed = a is not in the run"),
    "load seed []": (lambda: hitmdp_jax.load("run", seed=[]), "seed = [] is not in the run"),
    "load checkpoint": (lambda: hitmdp_jax.load("run", checkpoint=9), "holds no checkpoint 9"),
    "load checkpoint word": (lambda: hitmdp_jax.load("run", checkpoint="old"), "checkpoint old"),
    "load checkpoint None": (lambda: hitmdp_jax.load("run", checkpoint=None), "checkpoint None"),
    "load checkpoint 1.5": (lambda: hitmdp_jax.load("run", checkpoint=1.5), "checkpoint 1.5"),
    "load misfit": (lambda: hitmdp_jax.load("misfit"), "does not fit the algorithm"),
    "load torn": (lambda: hitmdp_jax.load("torn"), "No checkpoint in"),
    "save nothing": (lambda: hitmdp_jax.save("new", PPO(), None), "state is a NoneType"),
    "save parameters": (lambda: hitmdp_jax.save("new", PPO(), {"a": 1}), "state is a dict"),
    "save over a run": (
        lambda: hitmdp_jax.save("run", PPO(), untrained(PPO(), 1)),
        "'run' holds a run already",
    ),
    "save into a file": (
        lambda: hitmdp_jax.save("notes.txt", PPO(), untrained(PPO(), 1)),
        "notes.txt is not a folder",
    ),
    "save a class": (lambda: hitmdp_jax.save("new", PPO, untrained(PPO(), 1)), "PPO"),
    "save another agent": (
        lambda: hitmdp_jax.save("new", DAC(), untrained(PPO(), 1)),
        "does not fit",
    ),
    "save None": (lambda: hitmdp_jax.save("new", None, untrained(PPO(), 1)), "not an agent"),
    "act on a number": (lambda: act(3.0), "obs has shape ()"),
    "act on a wrong size": (lambda: act(np.zeros(99)), "obs has shape (99,)"),
    "act on a batch of wrong size": (lambda: act(np.zeros((2, 99))), "obs has shape (2, 99)"),
    "act on words": (lambda: act("abc"), "obs"),
    "score in no engine": (lambda: scored(engine="gym"), "Unknown engine 'gym'"),
    "score in None": (lambda: scored(engine=None), "Unknown engine 'None'"),
    "score no episodes": (lambda: scored(episodes=0), "episodes = 0 must be"),
    "score half an episode": (lambda: scored(episodes=0.5), "episodes = 0.5 must be"),
    "score words": (lambda: scored(episodes="a"), "episodes = a must be"),
    "score a run of no task": (
        lambda: RunConfig.load(Path("from_python")).task_at(1),
        "names no task",
    ),
    "read settings of nowhere": (lambda: RunConfig.load(Path("nowhere")), "is not a run's folder"),
    "settings without a name": (
        lambda: RunConfig.from_mapping({"algo": {}}),
        "algo = {} must hold a name",
    ),
    "settings without an algorithm": (
        lambda: RunConfig.from_mapping({"env": {"name": "hopper"}}),
        "algo = None must hold a name",
    ),
}  # fmt: skip


def untrained(agent, seeds, env=None):
    """Return zeros in the shape of a training state [S, ...], which needs no compiling."""
    init, _ = hitmdp_jax.make_train(agent, env or Turkey(), num_steps=2048)
    keys = jax.random.split(jax.random.key(0), seeds)
    shapes = jax.eval_shape(jax.vmap(init), keys)
    zeros = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), shapes.replace(key=()))
    return zeros.replace(key=keys)


def act(obs):
    policy = hitmdp_jax.load("run")
    return policy.act(obs, policy.initial_memory(jax.random.key(0)), jax.random.key(0))


def scored(engine="mjx", episodes=1):
    return score(hitmdp_jax.load("run"), {"name": "hopper"}, engine, episodes, jax.random.key(0))


OWN = """
from brax.envs.base import Env
from hitmdp_jax.agents import PPO, Agent

value = 3
def function(): ...
class Plain:
    pass
class Task(Env):
    def __init__(self, size=1): ...
    reset = step = observation_size = action_size = backend = None
class AbstractTask(Env):
    pass
class Abstract(Agent):
    pass
class Algo(PPO):
    pass
"""


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A folder with a good run in it, and with everything that a run's folder can be instead."""
    folder = tmp_path_factory.mktemp("workspace")
    (folder / "empty").mkdir()
    (folder / "notes.txt").write_text("mine\n")
    (folder / "own.py").write_text(OWN)
    settings = {
        "algo": {"name": "ppo"},
        "env": {"name": "toy/turkey"},
        "seeds": 2,
        "total_steps": 10_000,
    }

    def run(name, text=None, **changes):
        (folder / name).mkdir(parents=True)
        text = text or yaml.safe_dump({"schema": 1} | settings | changes)
        (folder / name / "config.yaml").write_bytes(text.encode("latin-1"))

    def with_checkpoint(name, **changes):
        run(name, **changes)
        shutil.copytree(folder / "run" / "checkpoints", folder / name / "checkpoints")
        return folder / name / "checkpoints"

    run("run")
    config = RunConfig.load(folder / "run")
    checkpoints = Checkpoints(folder / "run")
    checkpoints.save(Progress(2, 0, untrained(config.make_agent(), 2)))
    checkpoints.close()
    for path in with_checkpoint("torn").rglob("*"):
        if path.is_file():
            path.write_bytes(path.read_bytes()[:10])
    shutil.rmtree(with_checkpoint("garbage") / "2")
    (folder / "garbage" / "checkpoints" / "3").mkdir()
    (folder / "garbage" / "checkpoints" / "3" / "junk").write_text("junk")
    shutil.rmtree(with_checkpoint("stray") / "2")
    (folder / "stray" / "checkpoints" / "notes").mkdir()
    with_checkpoint("misfit", algo={"name": "ppo", "hidden_sizes": [32]})
    with_checkpoint("other_algo", algo={"name": "mopg"})
    with_checkpoint("other_seeds", seeds=3)
    with_checkpoint("other_env", env={"name": "hopper", "version": "v5"})
    with_checkpoint("from_python", env=None)
    with_checkpoint("compared/ppo")
    run("unsaved")
    run("broken", "algo: [")
    run("binary", "\xff\xfe\x00")
    run("blank", "\n")
    run("listed", "- 1\n")
    run("python_tag", "algo: !!python/object/apply:os.system ['touch hacked']\n")
    (folder / "directory" / "config.yaml").mkdir(parents=True)
    run("newer", schema=99)
    run("schema_word", schema="two")
    run("unknown_algo", algo={"name": "sac"})
    run("unknown_env", env={"name": "halfchetah"})
    run("unknown_setting", colour="red")
    run("number_key", **{"algo": {"name": "ppo"}}, text="3: 4\nalgo: {name: ppo}\n")
    run("no_algo", algo=None)
    run("wrong_type", seeds="two")
    run("wrong_env", env="halfcheetah")
    run("wrong_name", env={"name": [1]})
    run("wrong_keyword", env={"name": "toy/turkey", "colour": "red"})
    run("own_gone", env={"name": "gone.py:Task"})
    return folder


@pytest.fixture
def unchanged(workspace, monkeypatch):
    """Go to the workspace; nothing may be trained there, and every file must stay as it is."""

    def trained(*args, **kwargs):
        raise AssertionError("it was taken for good")

    monkeypatch.chdir(workspace)
    monkeypatch.setattr(loop, "prepare", trained)
    monkeypatch.setattr(arms, "train", trained)
    monkeypatch.setattr(reproduce.theorems, "sample_models", trained)
    for command in (train, evaluate, video, export):
        monkeypatch.setattr(command, "set_up_host", lambda *args: None)
    before = contents(workspace)
    yield
    assert contents(workspace) == before


def contents(folder):
    """Return when every file was written, and its size; but for what Python and a lock leave."""
    found = {}
    for path, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if name != "__pycache__"]
        found[path] = sorted(folders)
        for name in set(files) - {".lock"}:
            written = os.stat(os.path.join(path, name))
            found[path, name] = written.st_mtime_ns, written.st_size
    return found


def assert_explained(command, arguments, part, monkeypatch, capsys):
    """One sentence on stderr, nothing on stdout, exit code 2."""
    words = [word.strip("'") for word in arguments.split(" ") if word]
    monkeypatch.setattr(sys, "argv", ["command", *words])
    with pytest.raises(SystemExit) as stopped:
        command.main()
    out, err = capsys.readouterr()
    *warnings, last = err.splitlines()
    assert last.startswith("error: "), err
    assert part in last
    assert all(line.startswith("warning: ") for line in warnings)
    assert stopped.value.code == 2
    assert out == ""


@pytest.mark.usefixtures("unchanged")
@pytest.mark.parametrize(("arguments", "part"), TRAIN, ids=[row[0] or "nothing" for row in TRAIN])
def test_train(arguments, part, monkeypatch, capsys):
    assert_explained(train, arguments, part, monkeypatch, capsys)


@pytest.mark.usefixtures("unchanged")
@pytest.mark.parametrize(("name", "part"), FOLDERS, ids=[row[0] for row in FOLDERS])
def test_resume(name, part, monkeypatch, capsys):
    assert_explained(train, f"resume={name}", part, monkeypatch, capsys)


@pytest.mark.usefixtures("unchanged")
@pytest.mark.parametrize(("arguments", "part"), EVALUATE, ids=[row[0] for row in EVALUATE])
def test_evaluate(arguments, part, monkeypatch, capsys):
    assert_explained(evaluate, arguments, part, monkeypatch, capsys)


@pytest.mark.usefixtures("unchanged")
@pytest.mark.parametrize(("arguments", "part"), VIDEO, ids=[row[0] for row in VIDEO])
def test_video(arguments, part, monkeypatch, capsys):
    assert_explained(video, arguments, part, monkeypatch, capsys)


@pytest.mark.usefixtures("unchanged")
@pytest.mark.parametrize(("arguments", "part"), EXPORT, ids=[row[0] for row in EXPORT])
def test_export(arguments, part, monkeypatch, capsys):
    assert_explained(export, arguments, part, monkeypatch, capsys)


@pytest.mark.usefixtures("unchanged")
@pytest.mark.parametrize(("arguments", "part"), REPRODUCE, ids=[row[0] for row in REPRODUCE])
def test_reproduce(arguments, part, monkeypatch, capsys):
    assert_explained(reproduce, arguments, part, monkeypatch, capsys)


@pytest.mark.usefixtures("unchanged")
@pytest.mark.parametrize("mistake", PYTHON)
def test_python(mistake):
    call, part = PYTHON[mistake]
    with pytest.raises(UsageError) as error:
        call()
    assert part in str(error.value)
    assert "\n" not in str(error.value)
