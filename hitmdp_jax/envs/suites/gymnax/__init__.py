"""The tasks of gymnax (Lange 2022), such as `gymnax/CartPole-v1`."""

from hitmdp_jax.envs.suites.base import LibrarySuite

# Not MNISTBandit-bsuite, which fetches its pictures from the network.
NAMES = (
    "CartPole-v1",
    "Pendulum-v1",
    "Acrobot-v1",
    "MountainCar-v0",
    "MountainCarContinuous-v0",
    "Asterix-MinAtar",
    "Breakout-MinAtar",
    "Freeway-MinAtar",
    "Seaquest-MinAtar",
    "SpaceInvaders-MinAtar",
    "Catch-bsuite",
    "DeepSea-bsuite",
    "MemoryChain-bsuite",
    "UmbrellaChain-bsuite",
    "DiscountingChain-bsuite",
    "SimpleBandit-bsuite",
    "FourRooms-misc",
    "MetaMaze-misc",
    "PointRobot-misc",
    "BernoulliBandit-misc",
    "GaussianBandit-misc",
    "Reacher-misc",
    "Swimmer-misc",
    "Pong-misc",
    "FrozenLake-misc",
)
SUITE = LibrarySuite(
    prefix="gymnax/",
    package="gymnax",
    extra="gymnax",
    solves=False,
    folder=__name__,
    tasks=dict.fromkeys(NAMES, "task:constructor"),
)
