"""MiniGrid's tasks, as XLand-MiniGrid has them (Nikulin et al. 2024)."""

from hitmdp_jax.envs.suites.base import LibrarySuite

# Not XLand's own tasks: their rules are files that do not come with the library.
NAMES = (
    "MiniGrid-BlockedUnlockPickUp",
    "MiniGrid-DoorKey-5x5",
    "MiniGrid-DoorKey-6x6",
    "MiniGrid-DoorKey-8x8",
    "MiniGrid-DoorKey-16x16",
    "MiniGrid-Empty-5x5",
    "MiniGrid-Empty-6x6",
    "MiniGrid-Empty-8x8",
    "MiniGrid-Empty-16x16",
    "MiniGrid-EmptyRandom-5x5",
    "MiniGrid-EmptyRandom-6x6",
    "MiniGrid-EmptyRandom-8x8",
    "MiniGrid-EmptyRandom-16x16",
    "MiniGrid-FourRooms",
    "MiniGrid-LockedRoom",
    "MiniGrid-MemoryS8",
    "MiniGrid-MemoryS16",
    "MiniGrid-MemoryS32",
    "MiniGrid-MemoryS64",
    "MiniGrid-MemoryS128",
    "MiniGrid-Playground",
    "MiniGrid-Unlock",
    "MiniGrid-UnlockPickUp",
)
SUITE = LibrarySuite(
    prefix="xminigrid/",
    package="xminigrid",
    extra="xminigrid",
    solves=False,
    folder=__name__,
    tasks=dict.fromkeys(NAMES, "task:constructor"),
)
