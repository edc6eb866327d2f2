"""Servants of a robot's RT component, its execution context and its configuration."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NoReturn

from omniORB import CORBA

from robocorba import __version__
from robocorba.bridges.openrtm.corba import rt_profiles
from robocorba.bridges.openrtm.data_ports import InvalidValue
from robocorba.bridges.openrtm.life_cycle import ReturnCode, State
from robocorba.bridges.openrtm.robot_component import RobotComponent
from robocorba.stubs import RTC, RTC__POA, OpenRTM__POA, SDOPackage, SDOPackage__POA

TYPE, VENDOR, CATEGORY = "RoboCorbaRobot", "RoboCorba", "Mobile robot"
#: Handle of the component's own execution context.
OWN = 0

UNSUPPORTED = rt_profiles.return_code(ReturnCode.UNSUPPORTED)
BAD_PARAMETER = rt_profiles.return_code(ReturnCode.BAD_PARAMETER)


def _is_unsupported(self: Any, *arguments: Any) -> Any:
    return UNSUPPORTED


class ComponentServant(OpenRTM__POA.DataFlowComponent):
    """OpenRTM::DataFlowComponent. It has one execution context, its own, and takes part in no others: what those would
    call is not supported. `exit` is not either: a robot leaves when its process ends."""

    def __init__(self, component: RobotComponent) -> None:
        self._component = component
        self._own: Any = None
        self._context: Any = None
        self._configuration: Any = None
        self._ports: list[tuple[Any, Callable[[], Any]]] = []

    def begin(self, own: Any, context: Any, configuration: Any, ports: Sequence[tuple[Any, Callable[[], Any]]]) -> None:
        """Before calls are accepted. References of the component, its execution context, its configuration; and of
        its ports, with what makes their profiles."""
        self._own, self._context, self._configuration, self._ports = own, context, configuration, list(ports)

    def get_component_profile(self) -> Any:
        name = self._component.name
        about = {"robot": self._component.robot, "error": self._component.life_cycle.reason}
        description = "A robot of RoboCorba: pose, floor and ranges out, velocity in"
        ports, properties = [profile() for _, profile in self._ports], rt_profiles.properties(about)
        return RTC.ComponentProfile(name, TYPE, description, __version__, VENDOR, CATEGORY, ports, None, properties)

    def get_ports(self) -> list[Any]:
        return [port for port, _ in self._ports]

    # ---- execution contexts ----

    def is_alive(self, context: Any) -> bool:
        return self._is_own(context)

    def get_context(self, handle: int) -> Any:
        return self._context if handle == OWN else None

    def get_owned_contexts(self) -> list[Any]:
        return [self._context]

    def get_participating_contexts(self) -> list[Any]:
        return []

    def get_context_handle(self, context: Any) -> int:
        return OWN if self._is_own(context) else -1

    def attach_context(self, context: Any) -> int:
        return -1

    def initialize(self) -> Any:
        return rt_profiles.return_code(ReturnCode.PRECONDITION_NOT_MET)  # it is

    finalize = exit = detach_context = _is_unsupported
    on_initialize = on_finalize = on_startup = on_shutdown = on_activated = on_deactivated = _is_unsupported
    on_aborting = on_error = on_reset = on_execute = on_state_update = on_rate_changed = _is_unsupported

    def _is_own(self, context: Any) -> bool:
        return context is not None and bool(context._is_equivalent(self._context))

    # ---- SDO ----

    def get_sdo_id(self) -> str:
        return self._component.name

    def get_sdo_type(self) -> str:
        return TYPE

    def get_device_profile(self) -> Any:
        return SDOPackage.DeviceProfile(CATEGORY, VENDOR, TYPE, __version__, [])

    def get_configuration(self) -> Any:
        return self._configuration

    def get_service_profiles(self) -> list[Any]:
        return []

    def get_service_profile(self, id: str) -> NoReturn:
        raise SDOPackage.InvalidParameter(f"no service {id}")

    get_sdo_service = get_service_profile

    def get_monitoring(self) -> NoReturn:
        raise SDOPackage.InterfaceNotImplemented("Monitoring")

    def get_owned_organizations(self) -> list[Any]:
        return []

    get_organizations = get_owned_organizations

    def get_status_list(self) -> list[Any]:
        return []

    def get_status(self, name: str) -> NoReturn:
        raise SDOPackage.InvalidParameter(f"no status {name}")


class ExecutionContextServant(RTC__POA.ExecutionContextService):
    """RTC::ExecutionContextService of one component."""

    def __init__(self, component: RobotComponent) -> None:
        self._component = component
        self._owner: Any = None

    def begin(self, owner: Any) -> None:
        """Before calls are accepted. owner: the component's reference."""
        self._owner = owner

    def get_profile(self) -> Any:
        return RTC.ExecutionContextProfile(RTC.PERIODIC, self._component.rate_hz, self._owner, [], [])

    def get_kind(self) -> Any:
        return RTC.PERIODIC

    def is_running(self) -> bool:
        return self._component.is_running

    def start(self) -> Any:
        return rt_profiles.return_code(self._component.start())

    def stop(self) -> Any:
        return rt_profiles.return_code(self._component.stop())

    def get_rate(self) -> float:
        return self._component.rate_hz

    def set_rate(self, rate: float) -> Any:
        return rt_profiles.return_code(self._component.set_rate(rate))

    add_component = remove_component = _is_unsupported

    def activate_component(self, component: Any) -> Any:
        return self._change(component, self._component.life_cycle.activate)

    def deactivate_component(self, component: Any) -> Any:
        return self._change(component, self._component.life_cycle.deactivate)

    def reset_component(self, component: Any) -> Any:
        return self._change(component, self._component.life_cycle.reset)

    def get_component_state(self, component: Any) -> Any:
        is_own = self._is_owner(component)
        return rt_profiles.state(self._component.life_cycle.state if is_own else State.CREATED)

    def _change(self, component: Any, change: Callable[[], ReturnCode]) -> Any:
        return rt_profiles.return_code(change()) if self._is_owner(component) else BAD_PARAMETER

    def _is_owner(self, component: Any) -> bool:
        return component is not None and bool(component._is_equivalent(self._owner))


class ConfigurationServant(SDOPackage__POA.Configuration):
    """SDOPackage::Configuration: one set, which is active, and takes no others."""

    SET = "default"

    def __init__(self, component: RobotComponent) -> None:
        self._component = component

    def get_configuration_sets(self) -> list[Any]:
        return [self.get_active_configuration_set()]

    def get_active_configuration_set(self) -> Any:
        return SDOPackage.ConfigurationSet(self.SET, "", self.get_configuration_parameter_values())

    def get_configuration_set(self, id: str) -> Any:
        if id != self.SET:
            raise SDOPackage.NotAvailable(f"no set {id}")
        return self.get_active_configuration_set()

    def set_configuration_set_values(self, wanted: Any) -> bool:
        if wanted.id != self.SET:
            raise SDOPackage.InvalidParameter(f"no set {wanted.id}")
        return self._configure(wanted.configuration_data)

    def activate_configuration_set(self, id: str) -> bool:
        return bool(id == self.SET)

    def get_configuration_parameters(self) -> list[Any]:
        return []

    def get_configuration_parameter_values(self) -> list[Any]:
        return rt_profiles.properties(self._component.configuration)

    def get_configuration_parameter_value(self, name: str) -> Any:
        values = self._component.configuration
        if name not in values:
            raise SDOPackage.InvalidParameter(f"no parameter {name}")
        return CORBA.Any(CORBA.TC_string, values[name])

    def set_configuration_parameter(self, name: str, value: Any) -> bool:
        return self._configure([SDOPackage.NameValue(name, value)])

    def _configure(self, values: Iterable[Any]) -> bool:
        try:
            self._component.configure(rt_profiles.properties_of(values))
        except InvalidValue as error:
            raise SDOPackage.InvalidParameter(str(error)) from None
        return True

    def _refuse(self, *arguments: Any) -> bool:
        return False

    set_device_profile = add_service_profile = add_organization = _refuse
    remove_service_profile = remove_organization = add_configuration_set = remove_configuration_set = _refuse
