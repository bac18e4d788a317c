import dataclasses

import numpy as np
from hypothesis import given

from tests.theory import exact

from .strategies import few, option_models, random_option_model


@few
@given(option_models())
def test_proposition_d_1_1_state_and_option_values_are_the_smdps(model):
    smdp, hidden = exact.evaluate_smdp(model), exact.evaluate(model)
    np.testing.assert_allclose(hidden.v, smdp.v, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(hidden.q_option, smdp.q_option, rtol=1e-10, atol=1e-10)


@few
@given(option_models())
def test_proposition_d_1_2_option_action_values_are_the_smdps(model):
    # Eq. 34, everything on the right from multi-time models
    smdp = exact.evaluate_smdp(model)
    terminate = model.termination.T
    arrival = (1 - terminate) * smdp.q_option + terminate * smdp.v[:, None]
    expected = model.reward[:, None] + model.gamma * np.einsum(
        "sat,to->soa", model.transition, arrival
    )
    np.testing.assert_allclose(exact.evaluate(model).q_action, expected, rtol=1e-10, atol=1e-10)


@few
@given(option_models())
def test_proposition_d_1_3_value_upon_arrival_is_the_smdps(model):
    smdp = exact.evaluate_smdp(model)
    advantage = smdp.q_option - smdp.v[:, None]
    eq_37 = smdp.q_option - model.termination.T * advantage
    np.testing.assert_allclose(
        exact.option_value_upon_arrival(model), eq_37, rtol=1e-10, atol=1e-10
    )


def test_options_of_one_step_have_one_step_models():
    model = dataclasses.replace(random_option_model(), termination=np.ones((3, 2)))
    options = exact.multi_time_model(model)
    reward = np.einsum("ksa,sa->ks", model.action, model.reward)
    chain = 0.9 * np.einsum("ksa,sat->kst", model.action, model.transition)
    np.testing.assert_allclose(options.reward, reward, rtol=1e-13)
    np.testing.assert_allclose(options.transition, chain, rtol=1e-13)


def test_options_that_never_terminate_return_nowhere():
    model = dataclasses.replace(random_option_model(), termination=np.zeros((3, 2)))
    options = exact.multi_time_model(model)
    np.testing.assert_array_equal(options.transition, 0)
    np.testing.assert_allclose(options.reward.T, exact.evaluate(model).q_option, rtol=1e-12)


def test_initiation_sets_enter_both_formulations():
    initiation = np.array([[True, True], [False, True], [True, False]])
    model = dataclasses.replace(random_option_model(), initiation=initiation)
    np.testing.assert_allclose(exact.evaluate(model).v, exact.evaluate_smdp(model).v, rtol=1e-12)
    everywhere = dataclasses.replace(model, initiation=None)
    assert np.abs(exact.evaluate(everywhere).v - exact.evaluate(model).v).max() > 1e-3
